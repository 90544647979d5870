"""What is measured, and how: `python -m bench.ROOM.NAME`; tables are in bench/results."""

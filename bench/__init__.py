"""Measurements: `python -m bench.ROOM.NAME`; tables are in bench/results."""

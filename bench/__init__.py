"""Measurements: `python -m bench.FOLDER.NAME`; tables are in bench/results."""

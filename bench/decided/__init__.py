"""Benches whose decision is taken and whose table stands; kept to be run again when a decision is doubted."""

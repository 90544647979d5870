"""The optics of a view: its exposure, its lens and its pose."""

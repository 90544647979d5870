"""Exposure planning: the meter, noise models of cameras, the planner. No file is written here."""

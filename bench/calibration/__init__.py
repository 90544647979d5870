"""Calibration, measured against the truth and against peers: poses, boards; `light`: sensors, colour."""

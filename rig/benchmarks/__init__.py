"""Data sets of papers, trained and measured as their papers do it: import, calibration, scene, table."""

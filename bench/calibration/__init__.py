"""Calibration, measured against the truth and against peers: sensors, response, colour, boards, poses."""

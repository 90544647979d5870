"""Session to calibration: exposure ratios, response, vignetting, lens and poses."""

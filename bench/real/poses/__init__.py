"""Calibrations of real photographs: poses and lenses against other programs and against measured cameras."""

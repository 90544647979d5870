"""Exposures, response and falloff: how code values become light. Poses are in `calib.poses`."""

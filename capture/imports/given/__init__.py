"""Calibration, split, depth and masks that come with photographs."""

"""Observation models, from rendered light to recorded values: tone curves, losses, and corrections of the
calibration.
"""

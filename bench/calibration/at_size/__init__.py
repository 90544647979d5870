"""Calibration of many views and of full-size photographs: accuracy, time and memory."""

"""Losses between a prediction and what was observed."""

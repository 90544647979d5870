"""Colours of a rig from a colour chart and shared scene points."""

"""Cameras that a scene is drawn from: paths round it, and those of other programs' files."""

"""Lenses, poses and scene points from features: structure from motion, and how sure it is."""

"""Poses, lenses and scene points from features: structure from motion, with the rig as a constraint."""

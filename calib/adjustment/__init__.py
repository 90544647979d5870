"""Poses, lenses and points of a model, adjusted together: to fractions of a pixel, and how sure they are."""

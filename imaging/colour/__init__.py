"""Colour spaces, and colour differences."""

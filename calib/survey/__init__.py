"""Placement of a scene in external coordinates: by surveyed points, by GPS, by another session."""

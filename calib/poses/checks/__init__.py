"""Checks of poses before they are believed: pairs that contradict, and views that are not confirmed."""

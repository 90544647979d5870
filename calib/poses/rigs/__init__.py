"""Cameras that are mounted to each other: the rig that their poses show, and views that it places."""

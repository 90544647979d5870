"""Drawings of poses: the rig, its views and its boards in space."""

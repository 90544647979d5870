"""Lenses and the rig from views of a ChArUco board: corners, a start, the adjustment, its uncertainty."""

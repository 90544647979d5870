"""Grouping of the views that look at a scene point from nearly the same side."""

import numpy as np

from imaging.arrays import Array, Integers

ASIDE = 10.0
"""Degrees between the first view of a side and its others: sheen changes little within them."""


def by_side(point: Integers, direction: Array) -> Integers:
    """Number of the side that each observation looks from, int64 [N]; sides of different points differ.

    point: of each observation [N]; direction: unit, from the point to the camera [N, 3]. The first
    observation of a point begins a side, those within `ASIDE` join it, the first of the others begins the
    next.
    """
    side = np.full(len(point), -1, np.int64)
    remaining, begun = np.arange(len(point)), 0
    while len(remaining):
        points, first, group = np.unique(point[remaining], return_index=True, return_inverse=True)
        cosine = (direction[remaining] * direction[remaining[first]][group]).sum(1)
        near = cosine >= np.cos(np.radians(ASIDE))
        near[first] = True  # whatever rounding does
        side[remaining[near]] = begun + group[near]
        remaining, begun = remaining[~near], begun + len(points)
    return side

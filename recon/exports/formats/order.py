"""Gaussians in an order in which neighbours in a file are neighbours in space, which compresses better."""

import numpy as np

from imaging.arrays import Array, Integers

_BITS = 10


def along_curve(means: Array) -> Integers:
    """The order of points [N, 3] along Morton's curve, int64 [N]; by ranks, so that far ones take no room."""
    code = np.zeros(len(means), np.int64)
    for axis in range(3):
        ranks = np.empty(len(means), np.int64)
        ranks[np.argsort(means[:, axis], kind="stable")] = np.arange(len(means))
        place = (ranks << _BITS) // max(len(means), 1)
        for bit in range(_BITS):
            code |= ((place >> bit) & 1) << (3 * bit + axis)
    return np.argsort(code, kind="stable")

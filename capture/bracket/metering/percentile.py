"""Both ends of what a camera sees, from two noisy takes of it."""

import math
from math import lcm
from typing import TypeVar

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from imaging.arrays import Array

DARK_PERCENTILE, BRIGHT_PERCENTILE = 0.1, 99.99
DARK_SHARE, BRIGHT_SHARE = DARK_PERCENTILE / 100.0, 1.0 - BRIGHT_PERCENTILE / 100.0
"""Shares of all pixels that may be darker, and brighter, than the range of a bracket."""
TAKES = 2
ENOUGH, BLOCK = 1 << 20, 4
"""Size of the sample kept of a frame, and the side of its blocks, spread evenly."""

HOT = 4.0

Pixel = TypeVar("Pixel", bound=np.generic)


def percentile(first: Array, other: Array, rank: float) -> float:
    """A percentile of the truth behind two noisy takes [n] of it: ranked in one, measured in the other.

    The median over all ranks beyond the percentile, which errs outwards as far as misjudged ranks err
    inwards; twice, with the takes exchanged, and averaged.
    """
    ranks = slice(0, math.ceil(min(rank, 100.0 - rank) / 100.0 * (len(first) - 1)) + 1)
    sign = 1.0 if rank < 50.0 else -1.0
    pairs = ((first, other), (other, first))
    return float(np.mean([np.median(b[np.argsort(sign * a, kind="stable")[ranks]]) for a, b in pairs]))


def subsampled(pixels: npt.NDArray[Pixel], period: int = 1) -> npt.NDArray[Pixel]:
    """Evenly spread blocks of a large frame [H, W, ...]: they have the percentiles of the whole.

    period: of a mosaic, whose photosites keep their places in its tile.
    """
    height, width = pixels.shape[:2]
    step = math.ceil(math.sqrt(pixels.size / ENOUGH))
    if step == 1:
        return pixels
    block = lcm(BLOCK, period)
    rows, columns = (np.flatnonzero(np.arange(n) // block % step == 0) for n in (height, width))
    return pixels[np.ix_(rows, columns)]


def without_hot_pixels(plane: Array) -> Array:
    """One colour [H, W] without hot photosites: those HOT times above their eight neighbours.

    They become as bright as the brightest of these. A lens spreads a true highlight further.
    """
    neighbours = np.ones((3, 3), bool)
    neighbours[1, 1] = False
    others = np.maximum(ndimage.maximum_filter(plane, footprint=neighbours, mode="mirror"), 0.0)
    return np.where(plane > HOT * others, others, plane)

"""The tables that the kernels hand on to each other, as named tuples (Numba reads them as such)."""

from typing import NamedTuple

import numpy as np

from imaging.arrays import AnyArray


class Projected(NamedTuple):
    """Results of `project` for each of N Gaussians."""

    shape: AnyArray
    """float64 [N, shape_size(C)]: pixel mean x, y; m11, m21, m22; the rest is `paint`. With (dx, dy) the
    offset from the mean, alpha = opacity 2^-q, q = (m11 dx)^2 + (m21 dx + m22 dy)^2, drawn where
    q <= reach."""
    paint: AnyArray
    """float32 [N, 2 shape_size(C)], the same memory: from column PAINT on -reach, opacity, the C colours."""
    box: AnyArray
    """int32 [N, 4]: first and last column, first and last row of pixels that the ellipse may touch."""
    depth: AnyArray
    """float32 [N]: camera z."""
    radius: AnyArray
    """float32 [N]: three sigma of the longer axis, px."""
    state: AnyArray
    """uint8 [N]: SKIPPED, DRAWN or BAD."""


class Entries(NamedTuple):
    """The tiles of each Gaussian, Gaussian after Gaussian."""

    start: AnyArray
    """int64 [N + 1]: where each Gaussian's entries may begin."""
    number: AnyArray
    """int32 [N]: how many there are."""
    slot: AnyArray
    """int64 [N + 1]: the number of its first entry when entries are counted without gaps."""
    tile: AnyArray
    """int32 [capacity]"""
    bits: AnyArray
    """uint8 [capacity]: which of the tile's four blocks it touches."""


class Lists(NamedTuple):
    """The Gaussians of each tile, nearest first."""

    across: int
    """Tiles in a row of tiles."""
    start: AnyArray
    """int64 [tiles + 1]: where each tile's list begins."""
    id: AnyArray
    """uint32 [entries]: the Gaussian, and above ID_BITS its block bits."""
    slot: AnyArray
    """int32 [entries]: the entry's gradient slot."""
    chunk_start: AnyArray
    """int64 [tiles]: where a tile's chunks begin, all tiles counted."""


PAINT = 10


def shape_size(channels: int) -> int:
    """Columns of `Projected.shape`: one cache line of 64 bytes for up to four channels, else two."""
    return 8 if channels <= 4 else 16


SKIPPED, DRAWN, BAD = np.uint8(0), np.uint8(1), np.uint8(2)
"""States of a Gaussian: not in the image (or too faint); drawn; not finite or degenerate."""

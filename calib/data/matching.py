"""Which features of two views are the same: nearest neighbours by descriptor, by Lowe's ratio, both ways."""

from typing import Any

import numpy as np
import numpy.typing as npt

from imaging.compute.jit import kernel

Float = npt.NDArray[np.float32]
Index = npt.NDArray[np.int64]

RATIO = 0.8
"""Lowe's ratio of nearest to second nearest, angles between descriptors."""
FARTHEST = 0.7
"""Largest angle between descriptors that match, radians."""
ROWS = 1024
"""Rows of the table of cosines that are made at a time: with fewer a product costs more, with more memory."""


def unit(descriptors: npt.NDArray[Any]) -> Float:
    """Descriptors [K, 128] as float32, each of length 1."""
    own = descriptors.astype(np.float32)
    return np.asarray(own / (np.linalg.norm(own, axis=1, keepdims=True) + 1e-9), np.float32)


def match(one: npt.NDArray[Any], other: npt.NDArray[Any]) -> npt.NDArray[np.uint32]:
    """Pairs of indices [M, 2] of features that are each other's nearest.

    one, other: descriptors [K, 128] of any length. A matrix product and a single pass over it: many times
    faster on a CPU than COLMAP's own matcher, which builds an index for every pair of views.
    """
    if len(one) < 2 or len(other) < 2:
        return np.empty((0, 2), np.uint32)
    nearest, farther = _nothing(len(one)), _nothing(len(other))
    one, transposed = unit(one), np.ascontiguousarray(unit(other).T)
    for first in range(0, len(one), ROWS):
        _scan(one[first : first + ROWS] @ transposed, first, *nearest, *farther)
    own = np.arange(len(one))
    index = nearest[0]
    keep = _clear(*nearest) & (farther[0][index] == own) & _clear(*farther)[index]
    return np.stack([own[keep], index[keep]], axis=1).astype(np.uint32)


def _nothing(count: int) -> tuple[Index, Float, Float]:
    """Of each feature: which is nearest, and the cosines of the nearest and the second nearest."""
    return np.zeros(count, np.int64), np.full(count, -2, np.float32), np.full(count, -2, np.float32)


@kernel
def _scan(
    cosines: Float,
    first: int,
    row_index: Index,
    row_best: Float,
    row_second: Float,
    column_index: Index,
    column_best: Float,
    column_second: Float,
) -> None:
    """Take a part of the table of cosines [R, K], whose rows are numbered from `first`, into both sides."""
    rows, columns = cosines.shape
    for row in range(rows):
        best, second, index = np.float32(-2), np.float32(-2), 0
        for column in range(columns):
            cosine = cosines[row, column]
            if cosine > second:
                if cosine > best:
                    best, second, index = cosine, best, column
                else:
                    second = cosine
            if cosine > column_second[column]:
                if cosine > column_best[column]:
                    column_second[column] = column_best[column]
                    column_best[column] = cosine
                    column_index[column] = first + row
                else:
                    column_second[column] = cosine
        row_index[first + row], row_best[first + row], row_second[first + row] = index, best, second


def _clear(index: Index, best: Float, second: Float) -> npt.NDArray[np.bool_]:
    """Whether the nearest is near, and much nearer than the second."""
    nearest, next_one = (np.arccos(np.clip(cosine, -1, 1)) for cosine in (best, second))
    return np.asarray((nearest < FARTHEST) & (nearest < RATIO * next_one))

"""Which features of two views are the same: nearest neighbours by descriptor, by Lowe's ratio, both ways."""

import numpy as np
import numpy.typing as npt

Float = npt.NDArray[np.float32]
Index = npt.NDArray[np.intp]

RATIO = 0.8
"""Lowe's ratio of nearest to second nearest, angles between descriptors."""
FARTHEST = 0.7
"""Largest angle between descriptors that match, radians."""
ROWS = 512
"""Rows of the table of cosines that are made at a time, so that it stays in the cache."""


def match(one: Float, other: Float) -> npt.NDArray[np.uint32]:
    """Pairs of indices [M, 2] of features that are each other's nearest.

    one, other: unit descriptors, float32 [K, 128]. A matrix product and a few passes over it: many times
    faster on a CPU than COLMAP's own matcher, which builds an index for every pair of views.
    """
    if len(one) < 2 or len(other) < 2:
        return np.empty((0, 2), np.uint32)
    rows = _Nearest(len(one))
    columns = _Nearest(len(other))
    transposed = np.ascontiguousarray(other.T)
    for first in range(0, len(one), ROWS):
        cosines = one[first : first + ROWS] @ transposed
        columns.update(first, *_two_largest(cosines))
        rows.update_rows(first, *_two_largest(cosines.T))
    own = np.arange(len(one))
    good, good_back = rows.clear(), columns.clear()
    keep = good & (columns.index[rows.index] == own) & good_back[rows.index]
    return np.stack([own[keep], rows.index[keep]], axis=1).astype(np.uint32)


class _Nearest:
    """Of each feature: its nearest, and the cosines of the nearest and the second nearest."""

    def __init__(self, count: int) -> None:
        self.index = np.zeros(count, np.intp)
        self.best = np.full(count, -2, np.float32)
        self.second = np.full(count, -2, np.float32)

    def update(self, first: int, index: Index, best: Float, second: Float) -> None:
        """Take in what more candidates, numbered from `first`, offer to each feature."""
        nearer = best > self.best
        self.second = np.maximum(np.minimum(self.best, best), np.maximum(self.second, second))
        self.index[nearer] = first + index[nearer]
        self.best[nearer] = best[nearer]

    def update_rows(self, first: int, index: Index, best: Float, second: Float) -> None:
        """Take in all that is to know of the features from `first` on."""
        own = slice(first, first + len(index))
        self.index[own], self.best[own], self.second[own] = index, best, second

    def clear(self) -> npt.NDArray[np.bool_]:
        """Whether the nearest is near, and much nearer than the second."""
        nearest, next_one = (np.arccos(np.clip(cosine, -1, 1)) for cosine in (self.best, self.second))
        return np.asarray((nearest < FARTHEST) & (nearest < RATIO * next_one))


def _two_largest(table: Float) -> tuple[Index, Float, Float]:
    """Of each column of `table`: where its largest value is, that value, and the second largest."""
    columns = np.arange(table.shape[1])
    index = table.argmax(0)
    best = table[index, columns]
    table[index, columns] = -2
    second = table.max(0)
    table[index, columns] = best
    return index, best, second

"""Matching of features between two views: nearest neighbours by descriptor, by Lowe's ratio, both ways.

Nearest neighbours are exact, and most cosines are never made: the sum over the directions in which the
descriptors of the two views are longest, and the lengths of what is left of them, bound each from above (the
inequality of Cauchy and Schwarz), and a few per cent of these bounds exceed a second nearest so far.
"""

import numpy as np
import numpy.typing as npt

from imaging.arrays import AnyArray, Array32, Bytes, Integers, Mask
from imaging.compute.jit import kernel

Whole = npt.NDArray[np.int16]

RATIO = 0.8
"""Lowe's ratio of nearest to second nearest, angles between descriptors."""
FARTHEST = 0.7
"""Largest angle between descriptors that match, radians."""
DIRECTIONS = 47
"""Number of directions, of 128, for the bounds. With fewer more cosines are made, with more a bound costs
more.
"""
SAMPLED = 8
"""Stride of the descriptors from which the directions are computed."""
SLACK = np.float32(1e-5)
"""Slack of a bound, as a share of the squared length of the remainder: several times the rounding error."""
ROWS = 128
"""Rows of the table of bounds that are made at a time: more of them leave the cache."""
COLUMNS = 16
"""Number of bounds in one block."""


def unit(descriptors: AnyArray) -> Array32:
    """Descriptors [K, 128] as float32, each of length 1."""
    values = descriptors.astype(np.float32)
    return np.asarray(values / (np.linalg.norm(values, axis=1, keepdims=True) + 1e-9), np.float32)


def match(one: Bytes, other: Bytes) -> npt.NDArray[np.uint32]:
    """Pairs of indices [M, 2] of features that are each other's nearest.

    one, other: SIFT descriptors, uint8 [K, 128]. Many times faster on a CPU than COLMAP's own matcher, which
    builds an index for every pair of views.
    """
    if len(one) < 2 or len(other) < 2:
        return np.empty((0, 2), np.uint32)
    nearest, farther = _nothing(len(one)), _nothing(len(other))
    directions = _longest(one, other)
    (rows, whole, length), (columns, others, lengths) = (
        _parts(numbers, directions) for numbers in (one, other)
    )
    columns = np.ascontiguousarray(columns.T)
    for first in range(0, len(one), ROWS):
        bounds = rows[first : first + ROWS] @ columns
        _scan(bounds, first, whole, length, others, lengths, *nearest, *farther)
    numbers = np.arange(len(one))
    index = nearest[0]
    keep = _clear(*nearest) & (farther[0][index] == numbers) & _clear(*farther)[index]
    return np.stack([numbers[keep], index[keep]], axis=1).astype(np.uint32)


def _longest(one: Bytes, other: Bytes) -> Array32:
    """The orthonormal directions [128, DIRECTIONS] that have most of the squared lengths of descriptors."""
    sample = unit(np.concatenate([one[::SAMPLED], other[::SAMPLED]]))
    _, directions = np.linalg.eigh(sample.T @ sample)
    return np.asarray(directions[:, -DIRECTIONS:], np.float32)


def _parts(descriptors: Bytes, directions: Array32) -> tuple[Array32, Whole, Array32]:
    """Factors of the bounds [K, DIRECTIONS + 1] and of the cosines [K, 128], and 1 over the lengths [K]."""
    unit_rows = unit(descriptors)
    along = unit_rows @ directions
    remainder = np.sqrt(np.maximum(1 - (along**2).sum(axis=1), 0) + SLACK)
    squares = (descriptors.astype(np.float32) ** 2).sum(axis=1)
    return (
        np.column_stack([along, remainder]),
        descriptors.astype(np.int16),
        1 / np.sqrt(np.maximum(squares, 1)),
    )


def _nothing(count: int) -> tuple[Integers, Array32, Array32]:
    """Empty results for each feature: the nearest, and the cosines of the nearest and the second nearest."""
    return np.zeros(count, np.int64), np.full(count, -2, np.float32), np.full(count, -2, np.float32)


@kernel
def _scan(
    bounds: Array32,
    first: int,
    one: Whole,
    length: Array32,
    other: Whole,
    lengths: Array32,
    row_index: Integers,
    row_best: Array32,
    row_second: Array32,
    column_index: Integers,
    column_best: Array32,
    column_second: Array32,
) -> None:
    """Take a part of the table of bounds [R, K], whose rows are numbered from `first`, into both sides."""
    rows, columns = bounds.shape
    for row in range(rows):
        best, second, index = np.float32(-2), np.float32(-2), 0
        row_of_one = one[first + row]
        for begin in range(0, columns, COLUMNS):
            end = min(begin + COLUMNS, columns)
            above = False
            for column in range(begin, end):
                above |= bounds[row, column] > min(second, column_second[column])
            if not above:
                continue
            for column in range(begin, end):
                if bounds[row, column] <= min(second, column_second[column]):
                    continue
                product = np.int32(0)  # whole numbers, which may be summed several at once
                for part in range(row_of_one.shape[0]):
                    product += np.int32(row_of_one[part]) * np.int32(other[column, part])
                cosine = np.float32(product) * length[first + row] * lengths[column]
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


def _clear(index: Integers, best: Array32, second: Array32) -> Mask:
    """Return whether the nearest is near, and much nearer than the second."""
    nearest, next_one = (np.arccos(np.clip(cosine, -1, 1)) for cosine in (best, second))
    return np.asarray((nearest < FARTHEST) & (nearest < RATIO * next_one))

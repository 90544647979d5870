"""Matching of features between two views: nearest neighbours by descriptor, by Lowe's ratio, both ways.

All cosines are made, by a product of matrices of whole numbers, whose sums float32 holds exactly: matches do
not depend on the machine. Of each row and each column the two largest are kept, many columns at a time.
"""

import numpy as np
import numpy.typing as npt

from imaging.arrays import AnyArray, Array32, Bytes, Mask
from imaging.compute.jit import kernel

RATIO = 0.8
"""Lowe's ratio of nearest to second nearest, angles between descriptors."""
FARTHEST = 0.7
"""Largest angle between descriptors that match, radians."""
ROWS = 256
"""Rows of the table of products that are made at a time: more of them leave the cache."""
LANES = 32
"""Columns that are looked at together, as vector instructions do."""


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
    rows, length = _parts(one, len(one))
    columns, lengths = _parts(other, len(other) + -len(other) % LANES)
    columns = np.ascontiguousarray(columns.T)
    nearest, farther = _nothing(len(one)), _nothing(len(lengths))
    table = np.empty((min(ROWS, len(one)), len(lengths)), np.float32)
    pairs = []
    for first in range(0, len(one), ROWS):
        part = slice(first, min(first + ROWS, len(one)))
        products = np.matmul(rows[part], columns, out=table[: part.stop - first])
        largest = nearest[:, part]
        _scan(products, length[part], lengths, largest, farther, np.empty((2, LANES), np.float32))
        clear = np.flatnonzero(_clear(largest))
        index = np.argmax(products[clear] * length[part][clear, None] * lengths, axis=1)
        pairs.append(np.stack([first + clear, index], axis=1))
    both = np.concatenate(pairs)
    # A column whose nearest is clear has no second row that is as near.
    mutual = _clear(farther)[both[:, 1]] & (farther[0][both[:, 1]] == nearest[0][both[:, 0]])
    return np.asarray(both[mutual], np.uint32)


def _parts(descriptors: Bytes, count: int) -> tuple[Array32, Array32]:
    """Descriptors [count, 128], with zeros behind the last, and 1 over their lengths [count], 0 of those."""
    values, over = np.zeros((count, descriptors.shape[1]), np.float32), np.zeros(count, np.float32)
    values[: len(descriptors)] = descriptors
    over[: len(descriptors)] = 1 / np.sqrt(np.maximum((values[: len(descriptors)] ** 2).sum(axis=1), 1))
    return values, over


def _nothing(count: int) -> Array32:
    """The cosines of the nearest and the second nearest [2, count] before any is known."""
    return np.full((2, count), -2, np.float32)


@kernel
def _scan(
    products: Array32, length: Array32, lengths: Array32, nearest: Array32, farther: Array32, lanes: Array32
) -> None:
    """Take a part of the table [R, K] into both sides: of its rows [2, R], and of all columns [2, K].

    lanes: [2, LANES], room for the two largest of every LANES-th column of a row. Comparisons, since the
    minimum and the maximum of numbers that may be NaN are not made many at a time.
    """
    line = lengths.reshape(-1, LANES)
    above, below = farther[0].reshape(-1, LANES), farther[1].reshape(-1, LANES)
    best, second = lanes[0], lanes[1]
    for row in range(products.shape[0]):
        best[:] = np.float32(-2)
        second[:] = np.float32(-2)
        over = length[row]
        of_row = products[row].reshape(-1, LANES)
        for block in range(of_row.shape[0]):
            for lane in range(LANES):
                cosine = of_row[block, lane] * over * line[block, lane]
                largest = best[lane]
                less = cosine if cosine < largest else largest
                second[lane] = less if less > second[lane] else second[lane]
                best[lane] = cosine if cosine > largest else largest
                largest = above[block, lane]
                less = cosine if cosine < largest else largest
                below[block, lane] = less if less > below[block, lane] else below[block, lane]
                above[block, lane] = cosine if cosine > largest else largest
        for lane in range(LANES):
            for cosine in (best[lane], second[lane]):
                if cosine > nearest[0, row]:
                    nearest[0, row], nearest[1, row] = cosine, nearest[0, row]
                elif cosine > nearest[1, row]:
                    nearest[1, row] = cosine


def _clear(cosines: Array32) -> Mask:
    """Return whether the nearest is near, and much nearer than the second; cosines: [2, K]."""
    nearest, next_one = np.arccos(np.clip(cosines, -1, 1))
    return np.asarray((nearest < FARTHEST) & (nearest < RATIO * next_one))

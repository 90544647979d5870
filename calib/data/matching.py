"""Matching of features between two views: nearest neighbours by descriptor, by Lowe's ratio, both ways.

All cosines are made, by a product of matrices of whole numbers, whose sums float32 holds exactly: matches do
not depend on the machine. Where a processor multiplies bytes (VNNI), that product takes a quarter of the time
it takes by floats. Of each row and each column the two largest are kept, many columns at a time.
"""

from collections.abc import Callable
from functools import cache

import numpy as np
import numpy.typing as npt
from llvmlite import binding  # type: ignore[import-untyped]
from threadpoolctl import ThreadpoolController

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
MIDDLE = 128
"""Taken from each number of a descriptor, which then fits a byte with a sign."""
WORTHWHILE = 1e9
"""Products of two descriptors from which torch is loaded to make them by bytes: that takes 1.3 s, and 36
million products 0.08 s less.
"""
_INSTRUCTIONS = "avx512vnni", "avxvnni"
"""Names of those that multiply bytes; without either, such products saturate or are slower."""


def unit(descriptors: AnyArray) -> Array32:
    """Descriptors [K, 128] as float32, each of length 1."""
    values = descriptors.astype(np.float32)
    return np.asarray(values / (np.linalg.norm(values, axis=1, keepdims=True) + 1e-9), np.float32)


def multiplies_bytes(products: float) -> bool:
    """Return whether that many products of two descriptors are made sooner by bytes than by floats."""
    return products >= WORTHWHILE and _has_instructions()


@cache
def _has_instructions() -> bool:
    features = binding.get_host_cpu_features()
    return any(features.get(name, False) for name in _INSTRUCTIONS)


def match(one: Bytes, other: Bytes, *, by_bytes: bool = False) -> npt.NDArray[np.uint32]:
    """Pairs of indices [M, 2] of features that are each other's nearest.

    one, other: SIFT descriptors, uint8 [K, 128]. Many times faster on a CPU than COLMAP's own matcher, which
    builds an index for every pair of views. by_bytes: multiply bytes instead of floats, which gives the same
    where a processor has instructions for it (`multiplies_bytes`).
    """
    if len(one) < 2 or len(other) < 2:
        return np.empty((0, 2), np.uint32)
    row_bytes, length, add = _parts(one, len(one))
    column_bytes, lengths, adds = _parts(other, len(other) + -len(other) % LANES)
    rows: AnyArray = row_bytes if by_bytes else row_bytes.astype(np.float32)
    columns: AnyArray = column_bytes.T if by_bytes else np.ascontiguousarray(column_bytes.T, np.float32)
    multiply: Callable[..., object] = _multiply_bytes if by_bytes else np.matmul
    nearest, farther = _nothing(len(one)), _nothing(len(lengths))
    table = np.empty((min(ROWS, len(one)), len(lengths)), np.int32 if by_bytes else np.float32)
    # Numba adds whole numbers to float32 as float64.
    add, adds = add.astype(table.dtype), adds.astype(table.dtype)
    pairs = []
    for first in range(0, len(one), ROWS):
        part = slice(first, min(first + ROWS, len(one)))
        products = table[: part.stop - first]
        multiply(rows[part], columns, out=products)
        largest = nearest[:, part]
        lanes = np.empty((2, LANES), np.float32)
        _scan(products, add[part], adds, length[part], lengths, largest, farther, lanes)
        clear = np.flatnonzero(_clear(largest))
        dots = (products[clear] + add[part][clear, None] + adds).astype(np.float32)
        index = np.argmax(dots * length[part][clear, None] * lengths, axis=1)
        pairs.append(np.stack([first + clear, index], axis=1))
    both = np.concatenate(pairs)
    # A column whose nearest is clear has no second row that is as near.
    mutual = _clear(farther)[both[:, 1]] & (farther[0][both[:, 1]] == nearest[0][both[:, 0]])
    return np.asarray(both[mutual], np.uint32)


def _parts(descriptors: Bytes, count: int) -> tuple[npt.NDArray[np.int8], Array32, AnyArray]:
    """Descriptors less MIDDLE [count, 128], with empty ones behind the last; 1 over their lengths [count], 0
    of empty ones; what a product of such lacks of that of the descriptors, by this side of it [count]."""
    values = np.zeros((count, descriptors.shape[1]), np.uint8)
    values[: len(descriptors)] = descriptors
    lacks = MIDDLE * values.sum(axis=1, dtype=np.int32) - MIDDLE**2 * values.shape[1] // 2
    squares = np.einsum("kd,kd->k", values, values, dtype=np.int64)
    over = np.zeros(count, np.float32)
    over[: len(descriptors)] = 1 / np.sqrt(np.maximum(squares[: len(descriptors)], 1).astype(np.float32))
    return (values ^ MIDDLE).view(np.int8), over, lacks.astype(np.int32)


def _multiply_bytes(rows: npt.NDArray[np.int8], columns: npt.NDArray[np.int8], out: AnyArray) -> None:
    """Write the product of [R, 128] and [128, K] to int32 [R, K], on this thread."""
    import torch

    with _threads().limit(limits=1, user_api="openmp"):
        torch._int_mm(torch.from_numpy(rows), torch.from_numpy(columns), out=torch.from_numpy(out))


@cache
def _threads() -> ThreadpoolController:
    """Threads of torch, which has to be loaded."""
    return ThreadpoolController()


def _nothing(count: int) -> Array32:
    """The cosines of the nearest and the second nearest [2, count] before any is known."""
    return np.full((2, count), -2, np.float32)


@kernel
def _scan(
    products: AnyArray,
    add: AnyArray,
    adds: AnyArray,
    length: Array32,
    lengths: Array32,
    nearest: Array32,
    farther: Array32,
    lanes: Array32,
) -> None:
    """Take a part of the table [R, K] into both sides: of its rows [2, R], and of all columns [2, K].

    add, adds: what each product lacks by its row and its column.
    lanes: [2, LANES], room for the two largest of every LANES-th column of a row. Comparisons, since the
    minimum and the maximum of numbers that may be NaN are not made many at a time.
    """
    line, lacks = lengths.reshape(-1, LANES), adds.reshape(-1, LANES)
    above, below = farther[0].reshape(-1, LANES), farther[1].reshape(-1, LANES)
    best, second = lanes[0], lanes[1]
    for row in range(products.shape[0]):
        best[:] = np.float32(-2)
        second[:] = np.float32(-2)
        over, lack = length[row], add[row]
        of_row = products[row].reshape(-1, LANES)
        for block in range(of_row.shape[0]):
            for lane in range(LANES):
                cosine = (
                    np.float32(of_row[block, lane] + lack + lacks[block, lane]) * over * line[block, lane]
                )
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

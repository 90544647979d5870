"""Numba's compiler as a typed decorator, and loops shared among threads.

Compiled code is kept for the next start of the program and runs without Python's lock, so plain threads
use all cores. Numba's own parallel loops go through OpenMP, which must not be forked after use and
stalls when other programs want the cores too.
"""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar, cast

from numba import njit

FunctionT = TypeVar("FunctionT", bound=Callable[..., object])


def compiled(function: FunctionT) -> FunctionT:
    """Compile a function of numbers and arrays."""
    return cast(FunctionT, njit(cache=True, nogil=True)(function))


def share(count: int, stride: int, work: Callable[[int, int], None]) -> None:
    """Call `work(first, last)` on pieces of `stride` that cover 0..count, on all cores of this process."""
    pieces = [(first, min(first + stride, count)) for first in range(0, count, stride)]
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    with ThreadPoolExecutor(max_workers=min(cores, max(len(pieces), 1))) as pool:
        for _ in pool.map(lambda piece: work(*piece), pieces):
            pass

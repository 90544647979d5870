"""Numba's compiler as typed decorators; compiled code is kept for the next start of the program."""

from collections.abc import Callable
from typing import TypeVar, cast

from numba import njit

FunctionT = TypeVar("FunctionT", bound=Callable[..., object])


def compiled(function: FunctionT) -> FunctionT:
    """Compile a function of numbers and arrays."""
    return cast(FunctionT, njit(cache=True)(function))


def compiled_parallel(function: FunctionT) -> FunctionT:
    """Compile a function whose `prange` loops run on all cores."""
    return cast(FunctionT, njit(cache=True, parallel=True)(function))

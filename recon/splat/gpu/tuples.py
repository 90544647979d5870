# mypy: allow-untyped-defs, allow-incomplete-defs, allow-untyped-calls, allow-untyped-decorators
"""Tuples of numbers that a kernel builds in a loop unrolled at compile time."""

import triton
import triton.language as tl

from recon.splat import parameters

_COUNT = tl.constexpr(parameters.COUNT)


@triton.jit
def appended(values, value):
    """The tuple with one value more."""
    return values + (value,)  # noqa: RUF005  Triton does not know the star


@triton.jit
def read_parameters(pointer):
    """All numbers of the vector of `recon.splat.parameters`."""
    found = ()
    for a in tl.static_range(_COUNT):
        found = appended(found, tl.load(pointer + a))
    return found

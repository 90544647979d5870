"""The algebra of the projection and of its gradient, written once for Numba's lanes and for Triton.

`lens_formulas` and `ellipse_formulas` are given a `Language` and return functions of its compiler: each
kernel unpacks those that it calls. They use nothing but + - * / and what the language has, and end in one
`return`, since Triton knows no other. `k` is the vector of `recon.splat.parameters`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

Operation = Callable[..., Any]


@dataclass(frozen=True)
class Language:
    """Operations of the formulas in a compiler's language.

    function: decorates a function that kernels call. index, number: an int, a float of the formulas as
    constants have to be.
    above, at_least: masks of a > b, a >= b; choose(mask, a, b): a where the mask is set, else b.
    """

    function: Operation
    index: Operation
    number: Operation
    root: Operation
    minus: Operation
    minimum: Operation
    maximum: Operation
    above: Operation
    at_least: Operation
    both: Operation
    choose: Operation

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""The formulas of the projection as Triton has them; see `recon.splat.formulas`."""

import inspect

import triton
import triton.language as tl

from recon.splat.formulas import Language
from recon.splat.formulas.ellipse import ellipse_formulas
from recon.splat.formulas.lens import lens_formulas


@triton.jit
def _root(x):
    return tl.sqrt(x)


@triton.jit
def _minus(x):
    return -x


@triton.jit
def _minimum(a, b):
    return tl.minimum(a, b)


@triton.jit
def _maximum(a, b):
    return tl.maximum(a, b)


@triton.jit
def _above(a, b):
    return a > b


@triton.jit
def _at_least(a, b):
    return a >= b


@triton.jit
def _both(a, b):
    return a & b


@triton.jit
def _choose(mask, a, b):
    return tl.where(mask, a, b)


def _jit(function):
    # Triton's interpreter runs a function with its globals alone, and looks for its language among them.
    function.__globals__.update(inspect.getclosurevars(function).nonlocals, tl=tl)
    return triton.jit(function)


_LANGUAGE = Language(
    function=_jit,
    index=tl.constexpr,
    number=tl.constexpr,
    root=_root,
    minus=_minus,
    minimum=_minimum,
    maximum=_maximum,
    above=_above,
    at_least=_at_least,
    both=_both,
    choose=_choose,
)

_LENS = lens_formulas(_LANGUAGE)
_ELLIPSE = ellipse_formulas(_LANGUAGE, _LENS)

distort = _LENS.distort
to_camera = _ELLIPSE.to_camera
rotation = _ELLIPSE.rotation
screen_axes = _ELLIPSE.screen_axes
root_covariance = _ELLIPSE.root_covariance
covariance = _ELLIPSE.covariance
shape_gradient = _ELLIPSE.shape_gradient
axes_gradient = _ELLIPSE.axes_gradient
jacobian_gradient = _ELLIPSE.jacobian_gradient
point_gradient = _ELLIPSE.point_gradient
motion_gradient = _ELLIPSE.motion_gradient
lens_gradient = _ELLIPSE.lens_gradient

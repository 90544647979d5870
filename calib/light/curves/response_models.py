"""Shapes of a response curve, from none to free: each maps a code to ln(light).

A value for every code (Debevec and Malik, SIGGRAPH 97) is not among them: where exposures are in equal steps
its ripples of that period change no held-out sample, and cost 3 to 10 % of error.

All of them meet sRGB at one code, so that grey stays grey and the curves of a camera's channels share one
scale. Each gives the curve and its derivatives on one grid of codes, from which all other values are
interpolated.
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np
import numpy.typing as npt
from scipy.interpolate import BSpline

from calib.light.curves.codes import HIGHEST, LOWEST
from imaging.arrays import Array
from imaging.colour.spaces import srgb_decode

Index = npt.NDArray[np.intp]

PER_CODE = 8
"""Points of the grid in a code."""
MIDDLE = 128
"""Code at which every curve meets sRGB, for each channel alike."""
KNOTS = 24
_ABOVE = 256.0 / 255.0
"""Code at which the light of a shoulder is without bound."""

GRID: Array = np.arange(0.0, 255.0 + 0.5 / PER_CODE, 1.0 / PER_CODE)
_CODES = np.maximum(GRID, 0.25)
"""Codes of the grid, without the zero that has no logarithm."""
_CENTRE = MIDDLE * PER_CODE


def at(codes: Array) -> Index:
    """Return where codes, 0..255, lie on the grid."""
    return np.rint(codes * PER_CODE).astype(np.intp)


SRGB: Array = np.asarray(np.log(srgb_decode(_CODES / 255.0)), np.float64)
"""ln of the light of sRGB codes on the grid."""


class Shape(Protocol):
    """A family of curves with parameters theta [P]."""

    @property
    def name(self) -> str:
        """Display name."""
        ...

    @property
    def start(self) -> Array:
        """Parameters to begin with."""
        ...

    @property
    def penalty(self) -> Array:
        """[P, P]: what is added to the whitened sum of squares is theta @ penalty @ theta."""
        ...

    def curve(self, theta: Array) -> Array:
        """ln light at every point of the grid."""
        ...

    def slopes(self, theta: Array) -> Array:
        """[len(grid), P]: its derivatives with respect to theta."""
        ...


@dataclass(frozen=True)
class Known:
    """sRGB (IEC 61966-2-1): nothing is free."""

    name: str = "sRGB"

    @property
    def start(self) -> Array:
        """No parameters."""
        return np.zeros(0)

    @property
    def penalty(self) -> Array:
        """Empty: there are no parameters."""
        return np.zeros((0, 0))

    def curve(self, theta: Array) -> Array:
        """Curve of sRGB."""
        return SRGB

    def slopes(self, theta: Array) -> Array:
        """Empty: there are no parameters."""
        return np.zeros((len(GRID), 0))


@dataclass(frozen=True)
class Gamma:
    """Light is a power of the code: one parameter, the exponent."""

    name: str = "gamma"

    @property
    def start(self) -> Array:
        """2.2."""
        return np.array([2.2])

    @property
    def penalty(self) -> Array:
        """Zero: nothing is penalised."""
        return np.zeros((1, 1))

    def curve(self, theta: Array) -> Array:
        """A straight line in ln code."""
        return np.asarray(SRGB[_CENTRE] + theta[0] * self._log[:, 0])

    def slopes(self, theta: Array) -> Array:
        """The same whatever the exponent."""
        return self._log

    @property
    def _log(self) -> Array:
        return np.asarray(np.log(_CODES / MIDDLE))[:, None]


@dataclass(frozen=True)
class Blend:
    """ln light is a sum of the logarithms that common curves are made of, and of powers of the code.

    Of ln code (any gamma), of sRGB, and of what a logistic shoulder lacks to its top; the terms beyond are
    powers of the code. A sigmoid of log light, a filmic curve, BT.709 and a logarithm lie within 0.5 % of
    six terms; and none of so few terms can ripple with the steps of a bracket.
    """

    terms: int

    @property
    def name(self) -> str:
        """Name with the number of its terms."""
        return f"blend of {self.terms} terms"

    @property
    def start(self) -> Array:
        """sRGB."""
        return np.asarray(np.eye(self.terms)[1])

    @property
    def penalty(self) -> Array:
        """Hardly any: only what keeps the equations soluble."""
        return 1e-6 * np.eye(self.terms)

    def curve(self, theta: Array) -> Array:
        """Their sum."""
        return np.asarray(SRGB[_CENTRE] + self._terms @ theta)

    def slopes(self, theta: Array) -> Array:
        """The same whatever theta is."""
        return self._terms

    @cached_property
    def _terms(self) -> Array:
        code = _CODES / 255.0
        powers = [code**order for order in range(1, self.terms - 2)]
        terms = np.stack([np.log(code), SRGB, -np.log(_ABOVE - code), *powers], axis=1)[:, : self.terms]
        return np.asarray(terms - terms[_CENTRE])


@dataclass(frozen=True)
class Spline:
    """A smooth departure from sRGB, of any form: cubic B-splines over the logarithm of sRGB light.

    There another exponent is a straight line, which costs nothing: the penalty is `smoothness` times the
    squared third differences of the coefficients. Beyond the codes that are used the departure stays.
    """

    smoothness: float
    name: str = field(default="spline", init=False)

    @property
    def start(self) -> Array:
        """sRGB itself."""
        return np.zeros(KNOTS)

    @property
    def penalty(self) -> Array:
        """Third differences, and as much as keeps the equations soluble."""
        bend = np.diff(np.eye(KNOTS), 3, axis=0)
        return np.asarray(self.smoothness * bend.T @ bend + 1e-6 * np.eye(KNOTS))

    def curve(self, theta: Array) -> Array:
        """sRGB and the departure."""
        return np.asarray(SRGB + _SPLINES @ theta)

    def slopes(self, theta: Array) -> Array:
        """The same whatever theta is."""
        return _SPLINES


def _splines() -> Array:
    lowest = SRGB[PER_CODE]
    place = np.clip(1.0 - SRGB / lowest, 0.0, 1.0)[at(np.clip(GRID, LOWEST, HIGHEST))]
    knots = np.concatenate([[0.0] * 3, np.linspace(0.0, 1.0, KNOTS - 2), [1.0] * 3])
    design = np.asarray(BSpline.design_matrix(place, knots, 3).toarray())
    return np.asarray(design - design[_CENTRE])


_SPLINES = _splines()

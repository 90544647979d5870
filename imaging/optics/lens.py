"""Points to pixels and pixels to rays through a calibrated lens, in numpy.

Brown-Conrady (OpenCV, COLMAP `OPENCV`): Brown, "Close-Range Camera Calibration", 1971. Fisheye (OpenCV's
fisheye module, COLMAP `OPENCV_FISHEYE`, Kalibr `equidistant`): Kannala and Brandt, "A Generic Camera Model
and Calibration Method for Conventional, Wide-Angle, and Fish-Eye Lenses", 2006, its radial terms.
"""

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field

from imaging.arrays import Array, Mask
from imaging.optics.pose import quarter_turns
from imaging.record import Record

LensModel = Literal["PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "RADIAL_FISHEYE", "OPENCV_FISHEYE"]


BROWN_TERMS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2")


FISHEYE_TERMS = ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4")


class Lens(Record):
    """A COLMAP camera model; pixel centres at +0.5. Parameters as `fx fy cx cy k1 k2 p1 p2` (OPENCV).

    `model` says which of them were free; the others are zero (or fx = fy). A fisheye (RADIAL_FISHEYE,
    OPENCV_FISHEYE) has `fx fy cx cy k1 k2 k3 k4`, terms in the angle from the axis. `project` applies it.
    """

    model: LensModel
    width: int = Field(gt=0)
    height: int = Field(gt=0)
    fx: float = Field(gt=0)
    fy: float = Field(gt=0)
    cx: float
    cy: float
    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    k3: float = 0.0
    k4: float = 0.0

    @property
    def fisheye(self) -> bool:
        """True if the terms apply to the angle from the axis, not to its tangent."""
        return self.model in ("RADIAL_FISHEYE", "OPENCV_FISHEYE")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the eight `terms`."""
        return FISHEYE_TERMS if self.fisheye else BROWN_TERMS

    @property
    def matrix(self) -> Array:
        """Focal lengths and principal point, float64 [3, 3]: the K of OpenCV, but for its pixel centres."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]], np.float64)

    @property
    def terms(self) -> tuple[float, ...]:
        """`fx fy cx cy k1 k2 p1 p2`, or of a fisheye `fx fy cx cy k1 k2 k3 k4`: COLMAP's order."""
        return tuple(float(getattr(self, name)) for name in self.names)

    def resized(self, width: int, height: int) -> "Lens":
        """The same lens seen on an image of another size."""
        x, y = width / self.width, height / self.height
        return self.model_copy(
            update={
                "width": width,
                "height": height,
                "fx": self.fx * x,
                "cx": self.cx * x,
                "fy": self.fy * y,
                "cy": self.cy * y,
            }
        )

    def as_held(self, orientation: int) -> "Lens":
        """The same lens on the upright picture, by the orientation that EXIF states of the stored one.

        Its axes are those of motions and pictures `as_held` (`imaging.optics.pose`).
        """
        lens = self
        for _ in range(quarter_turns(orientation)):
            turned = {"width": lens.height, "height": lens.width, "fx": lens.fy, "fy": lens.fx}
            turned |= {"cx": lens.cy, "cy": lens.width - lens.cx, "p1": -lens.p2, "p2": lens.p1}
            lens = lens.model_copy(update=turned)
        return lens


WIDEST = math.radians(88.0)
"""Largest angle from the axis. Tangents x/z end at a right angle, and near it they lose all digits."""
_ROUNDS = 80
"""Bisection steps at worst, where the slope of a lens ends; a handful elsewhere."""
_MISS = 1e-10
"""Largest miss of an inverted ray, in focal lengths."""


def project(lens: Lens, points: npt.ArrayLike) -> Array:
    """Pixels [..., 2] of points [..., 3] in camera axes, z positive; pixel centres at +0.5."""
    xyz = np.asarray(points, np.float64)
    bent = distort(xyz[..., :2] / xyz[..., 2:], lens.terms[4:], fisheye=lens.fisheye)
    return np.asarray(bent * (lens.fx, lens.fy) + (lens.cx, lens.cy))


def rays(lens: Lens, pixels: npt.ArrayLike) -> Array:
    """Unit directions [..., 3] in camera axes of pixels [..., 2]: the inverse of `project`."""
    bent = (np.asarray(pixels, np.float64) - (lens.cx, lens.cy)) / (lens.fx, lens.fy)
    tangents = undistort(bent, lens.terms[4:], fisheye=lens.fisheye)
    directions = np.concatenate([tangents, np.ones_like(tangents[..., :1])], axis=-1)
    return np.asarray(directions / np.linalg.norm(directions, axis=-1, keepdims=True))


def distort(tangents: Array, terms: Sequence[float], *, fisheye: bool) -> Array:
    """Project rays of tangents (x/z, y/z) [..., 2]; the result is in focal lengths from the principal point.

    terms: k1, k2, p1, p2, or of a fisheye k1, k2, k3, k4.
    """
    u, v = tangents[..., 0], tangents[..., 1]
    square = u * u + v * v
    if fisheye:
        radius = np.sqrt(square)
        some = radius > 0
        ratio = np.divide(fisheye_radius(np.arctan(radius), terms), radius, out=np.ones_like(u), where=some)
        return np.asarray(tangents * ratio[..., None])
    if not any(terms):
        return tangents
    k1, k2, p1, p2 = terms
    radial = 1 + square * (k1 + square * k2)
    x = u * radial + 2 * p1 * u * v + p2 * (square + 2 * u * u)
    y = v * radial + p1 * (square + 2 * v * v) + 2 * p2 * u * v
    return np.stack([x, y], axis=-1)


def undistort(bent: Array, terms: Sequence[float], *, fisheye: bool) -> Array:
    """The tangents [..., 2] that `distort` puts at places [..., 2].

    Exact to 1e-9 within the `fold` of the lens; what lies beyond (`covers`) is taken to lie on it.
    """
    if not fisheye and not any(terms):
        return bent
    radius = np.linalg.norm(bent, axis=-1)
    tangent = np.tan(fisheye_angle(radius, terms)) if fisheye else _brown_tangent(radius, terms)
    ratio = np.divide(tangent, radius, out=np.ones_like(radius), where=radius > 0)
    tangents = np.asarray(bent * ratio[..., None])
    return tangents if fisheye or not any(terms[2:]) else _with_tangential(bent, tangents, terms)


def covers(lens: Lens, pixels: npt.ArrayLike) -> Mask:
    """Return which pixels [..., 2] a ray ends at: not those beyond the fold of the lens."""
    bent = (np.asarray(pixels, np.float64) - (lens.cx, lens.cy)) / (lens.fx, lens.fy)
    terms, fisheye = lens.terms[4:], lens.fisheye
    again = distort(undistort(bent, terms, fisheye=fisheye), terms, fisheye=fisheye)
    return np.asarray(np.linalg.norm(again - bent, axis=-1) < _MISS)


def fold(terms: Sequence[float], *, fisheye: bool) -> float:
    """The tangent of the angle from the axis up to which rays farther out end farther out; inf: all do.

    Beyond it the radial terms fold the world back into the image. Of a fisheye at most the tangent of WIDEST.
    """
    return math.tan(min(fisheye_fold(terms), WIDEST)) if fisheye else _first_root(3 * terms[0], 5 * terms[1])


def _brown_tangent(radius: Array, terms: Sequence[float]) -> Array:
    """The tangent that the radial terms put at a radius, at most the fold: Newton's method in a bracket."""
    k1, k2 = terms[:2]

    def bent(tangent: Array) -> Array:
        square = tangent * tangent
        return np.asarray(tangent * (1 + square * (k1 + square * k2)))

    end = fold(terms, fisheye=False)
    low, high = np.zeros_like(radius), np.minimum(np.maximum(radius, 1e-9), end)
    while np.any(short := (bent(high) < radius) & (high < end)):
        high = np.where(short, np.minimum(2 * high, end), high)
    tangent = np.minimum(radius, high)
    for _ in range(_ROUNDS):
        miss, square = bent(tangent) - radius, tangent * tangent
        low, high = np.where(miss < 0, tangent, low), np.where(miss < 0, high, tangent)
        slope = 1 + square * (3 * k1 + square * 5 * k2)
        moved = tangent - np.divide(miss, slope, out=np.full_like(miss, np.inf), where=slope > 0)
        moved = np.where((moved > low) & (moved < high), moved, 0.5 * (low + high))
        if np.abs(moved - tangent).max(initial=0.0) < 1e-15:
            break
        tangent = moved
    return tangent


def _with_tangential(bent: Array, start: Array, terms: Sequence[float]) -> Array:
    """Newton's method from what the radial terms alone give; that itself where no ray ends."""
    k1, k2, p1, p2 = terms
    place, share = start, np.ones(start.shape[:-1])
    miss = bent - distort(place, terms, fisheye=False)
    for _ in range(_ROUNDS):
        u, v = place[..., 0], place[..., 1]
        square = u * u + v * v
        radial, growth = 1 + square * (k1 + square * k2), 2 * (k1 + 2 * square * k2)
        xx = radial + growth * u * u + 2 * p1 * v + 6 * p2 * u
        yy = radial + growth * v * v + 6 * p1 * v + 2 * p2 * u
        xy = growth * u * v + 2 * p1 * u + 2 * p2 * v
        area = xx * yy - xy * xy
        step = np.stack(
            [yy * miss[..., 0] - xy * miss[..., 1], xx * miss[..., 1] - xy * miss[..., 0]], axis=-1
        )
        step *= np.divide(share, area, out=np.zeros_like(area), where=area > 0)[..., None]
        residual = bent - distort(place + step, terms, fisheye=False)
        better = np.linalg.norm(residual, axis=-1) < np.linalg.norm(miss, axis=-1)
        place, miss = (
            np.where(better[..., None], place + step, place),
            np.where(better[..., None], residual, miss),
        )
        share = np.where(better, 1.0, 0.5 * share)
        if np.abs(step).max(initial=0.0) < 1e-15:
            break
    inside = np.linalg.norm(place, axis=-1) <= fold(terms, fisheye=False)
    ends = inside & (np.linalg.norm(miss, axis=-1) < _MISS)
    return np.where(ends[..., None], place, start)


def fisheye_radius(angle: Array, terms: Sequence[float]) -> Array:
    """theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8), in focal lengths; theta: radians."""
    k1, k2, k3, k4 = terms
    square = angle * angle
    return np.asarray(angle * (1 + square * (k1 + square * (k2 + square * (k3 + square * k4)))))


def fisheye_angle(radius: Array, terms: Sequence[float]) -> Array:
    """The angle from the axis, radians, that a fisheye puts at a radius; at most its fold, and WIDEST."""
    if not any(terms):
        return np.minimum(radius, WIDEST)
    low, high = np.zeros_like(radius), np.full_like(radius, min(fisheye_fold(terms), WIDEST))
    for _ in range(53):
        middle = 0.5 * (low + high)
        short = fisheye_radius(middle, terms) < radius
        low, high = np.where(short, middle, low), np.where(short, high, middle)
    return np.asarray(0.5 * (low + high))


def fisheye_fold(terms: Sequence[float]) -> float:
    """The angle from the axis, radians, where the radius of a fisheye stops growing; inf if nowhere."""
    k1, k2, k3, k4 = terms
    return _first_root(3 * k1, 5 * k2, 7 * k3, 9 * k4)


def _first_root(*terms: float) -> float:
    """Return where 1 + a x^2 + b x^4 + ... first becomes 0 for positive x; inf if nowhere."""
    inverse = np.roots([1.0, *terms])  # of 1 / x^2: no term is too small to divide by
    real = inverse.real[(np.abs(inverse.imag) <= 1e-12 * np.abs(inverse)) & (inverse.real > 0)]
    return float(1 / np.sqrt(real.max())) if len(real) else math.inf


def widest_angle(lens: Lens) -> float:
    """Angle of the farthest image corner from the axis, radians; inf if it lies beyond the fold.

    Of a fisheye, which is refused where this is more than WIDEST.
    """
    bent = np.array([[x, y] for x in (0.0, lens.width) for y in (0.0, lens.height)])
    radius = float(np.linalg.norm((bent - (lens.cx, lens.cy)) / (lens.fx, lens.fy), axis=-1).max())
    end = min(fisheye_fold(lens.terms[4:]), math.pi)
    angles = np.linspace(0.0, end, 4097)
    radii = fisheye_radius(angles, lens.terms[4:])
    return float(np.interp(radius, radii, angles)) if radius <= radii[-1] else math.inf

"""Points to pixels and pixels to rays through a calibrated lens, in numpy.

Brown-Conrady (OpenCV, COLMAP `OPENCV`): Brown, "Close-Range Camera Calibration", 1971. Fisheye (OpenCV's
fisheye module, COLMAP `OPENCV_FISHEYE`, Kalibr `equidistant`): Kannala and Brandt, "A Generic Camera Model
and Calibration Method for Conventional, Wide-Angle, and Fish-Eye Lenses", 2006, its radial terms.
"""

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from imaging.calibration import Lens

Array = npt.NDArray[np.float64]

WIDEST = math.radians(88.0)
"""From the axis. Tangents x/z end at a right angle, and near it they have no digits left."""


def project(lens: Lens, points: npt.ArrayLike) -> Array:
    """Pixels [..., 2] of points [..., 3] in camera axes, z positive; pixel centres at +0.5."""
    xyz = np.asarray(points, np.float64)
    bent = distort(xyz[..., :2] / xyz[..., 2:], lens.terms[4:], fisheye=lens.fisheye)
    return np.asarray(bent * (lens.fx, lens.fy) + (lens.cx, lens.cy))


def rays(lens: Lens, pixels: npt.ArrayLike) -> Array:
    """Unit directions [..., 3] in camera axes of pixels [..., 2]: the inverse of `project`."""
    bent = (np.asarray(pixels, np.float64) - (lens.cx, lens.cy)) / (lens.fx, lens.fy)
    tangents = undistort(bent, lens.terms[4:], fisheye=lens.fisheye)
    found = np.concatenate([tangents, np.ones_like(tangents[..., :1])], axis=-1)
    return np.asarray(found / np.linalg.norm(found, axis=-1, keepdims=True))


def distort(tangents: Array, terms: Sequence[float], *, fisheye: bool) -> Array:
    """Where a lens puts rays of tangents (x/z, y/z) [..., 2], in focal lengths from the principal point.

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

    Exact to 1e-9 for lenses that do not fold over. What lies beyond the fold of a fisheye, or beyond WIDEST,
    is taken to lie there.
    """
    if fisheye:
        radius = np.linalg.norm(bent, axis=-1)
        tangent = np.tan(fisheye_angle(radius, terms))
        ratio = np.divide(tangent, radius, out=np.ones_like(radius), where=radius > 0)
        return np.asarray(bent * ratio[..., None])
    tangents = bent.copy()
    if any(terms):
        for _ in range(50):
            miss = bent - distort(tangents, terms, fisheye=False)
            tangents = tangents + miss
            if np.abs(miss).max(initial=0) < 1e-10:
                break
    return tangents


def fisheye_radius(angle: Array, terms: Sequence[float]) -> Array:
    """theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8), in focal lengths; theta: radians."""
    k1, k2, k3, k4 = terms
    square = angle * angle
    return np.asarray(angle * (1 + square * (k1 + square * (k2 + square * (k3 + square * k4)))))


def fisheye_angle(radius: Array, terms: Sequence[float]) -> Array:
    """The angle from the axis, radians, that a fisheye puts at a radius; at most its fold, and WIDEST."""
    low, high = np.zeros_like(radius), np.full_like(radius, min(fisheye_fold(terms), WIDEST))
    for _ in range(53):
        middle = 0.5 * (low + high)
        short = fisheye_radius(middle, terms) < radius
        low, high = np.where(short, middle, low), np.where(short, high, middle)
    return np.asarray(0.5 * (low + high))


def fisheye_fold(terms: Sequence[float]) -> float:
    """The angle from the axis, radians, where the radius of a fisheye stops growing; inf if nowhere."""
    k1, k2, k3, k4 = terms
    roots = np.roots([9 * k4, 7 * k3, 5 * k2, 3 * k1, 1.0])
    real = roots.real[(np.abs(roots.imag) < 1e-12) & (roots.real > 0)]
    return float(np.sqrt(real.min())) if len(real) else math.inf


def widest_angle(lens: Lens) -> float:
    """How far from the axis the farthest corner of an image lies, radians; inf where it lies beyond the fold.

    Of a fisheye, which is refused where this is more than WIDEST.
    """
    bent = np.array([[x, y] for x in (0.0, lens.width) for y in (0.0, lens.height)])
    radius = float(np.linalg.norm((bent - (lens.cx, lens.cy)) / (lens.fx, lens.fy), axis=-1).max())
    end = min(fisheye_fold(lens.terms[4:]), math.pi)
    angles = np.linspace(0.0, end, 4097)
    radii = fisheye_radius(angles, lens.terms[4:])
    return float(np.interp(radius, radii, angles)) if radius <= radii[-1] else math.inf

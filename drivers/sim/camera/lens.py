"""Lenses with radial and tangential distortion (OpenCV's model) and fisheyes, exact in both directions."""

import math

import numpy as np
import numpy.typing as npt

from imaging.arrays import Array
from imaging.compute.jit import compiled
from imaging.optics.lens import Lens


@compiled
def distort(x: float, y: float, k1: float, k2: float, p1: float, p2: float) -> tuple[float, float]:
    """Return where the lens puts the ray (x, y, 1), in focal lengths from the principal point."""
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * k2)
    return (
        x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
        y * radial + 2.0 * p2 * x * y + p1 * (r2 + 2.0 * y * y),
    )


@compiled
def undistort(u: float, v: float, k1: float, k2: float, p1: float, p2: float) -> tuple[float, float]:
    """The ray (x, y, 1) that the lens puts at (u, v): Newton's method, to the last bits."""
    x, y = u, v
    for _ in range(20):
        r2 = x * x + y * y
        radial, slope = 1.0 + r2 * (k1 + r2 * k2), k1 + 2.0 * k2 * r2
        fx, fy = distort(x, y, k1, k2, p1, p2)
        a = radial + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
        b = 2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y
        d = radial + 2.0 * y * y * slope + 2.0 * p2 * x + 6.0 * p1 * y
        # The Jacobian is symmetric in this model.
        det = a * d - b * b
        ex, ey = fx - u, fy - v
        sx, sy = (d * ex - b * ey) / det, (a * ey - b * ex) / det
        x, y = x - sx, y - sy
        if sx * sx + sy * sy < 1e-28:
            break
    return x, y


@compiled
def undistort_fisheye(u: float, v: float, k1: float, k2: float, k3: float, k4: float) -> tuple[float, float]:
    """The same for a fisheye, up to a right angle from its axis."""
    radius = math.sqrt(u * u + v * v)
    if radius < 1e-12:
        return u, v
    angle = radius
    for _ in range(30):
        q = angle * angle
        distorted = angle * (1.0 + q * (k1 + q * (k2 + q * (k3 + q * k4))))
        slope = 1.0 + q * (3.0 * k1 + q * (5.0 * k2 + q * (7.0 * k3 + q * 9.0 * k4)))
        step = (distorted - radius) / slope
        angle -= step
        if abs(step) < 1e-15:
            break
    stretch = math.tan(angle) / radius
    return u * stretch, v * stretch


@compiled
def ray(column: float, row: float, lens: np.ndarray) -> tuple[float, float]:
    """Tangents (x/z, y/z) of the ray that reaches a place in the image, px; lens: `parameters`."""
    u, v = (column - lens[2]) / lens[0], (row - lens[3]) / lens[1]
    if lens[8] > 0.0:
        return undistort_fisheye(u, v, lens[4], lens[5], lens[6], lens[7])
    return undistort(u, v, lens[4], lens[5], lens[6], lens[7])


@compiled
def _rays(pixels: np.ndarray, lens: np.ndarray) -> np.ndarray:
    rays = np.empty_like(pixels)
    for i in range(pixels.shape[0]):
        rays[i, 0], rays[i, 1] = ray(pixels[i, 0], pixels[i, 1], lens)
    return rays


def parameters(lens: Lens) -> Array:
    """`fx fy cx cy k1 k2 p1 p2 0` as float64 [9]; of a fisheye `fx fy cx cy k1 k2 k3 k4 1`."""
    last = (lens.k3, lens.k4, 1.0) if lens.fisheye else (lens.p1, lens.p2, 0.0)
    return np.array([lens.fx, lens.fy, lens.cx, lens.cy, lens.k1, lens.k2, *last])


def project(lens: Lens, points: npt.ArrayLike) -> Array:
    """Pixels [..., 2] of points in camera axes [..., 3], z forward and positive."""
    xyz = np.asarray(points, np.float64)
    x, y = xyz[..., 0] / xyz[..., 2], xyz[..., 1] / xyz[..., 2]
    r2 = x * x + y * y
    if lens.fisheye:
        side = np.hypot(xyz[..., 0], xyz[..., 1])
        angle = np.arctan2(side, xyz[..., 2])
        bent = angle + lens.k1 * angle**3 + lens.k2 * angle**5 + lens.k3 * angle**7 + lens.k4 * angle**9
        turn = np.arctan2(xyz[..., 1], xyz[..., 0])
        u, v = bent * np.cos(turn), bent * np.sin(turn)
        return np.stack([lens.fx * u + lens.cx, lens.fy * v + lens.cy], axis=-1)
    radial = 1.0 + r2 * (lens.k1 + r2 * lens.k2)
    u = x * radial + 2.0 * lens.p1 * x * y + lens.p2 * (r2 + 2.0 * x * x)
    v = y * radial + 2.0 * lens.p2 * x * y + lens.p1 * (r2 + 2.0 * y * y)
    return np.stack([lens.fx * u + lens.cx, lens.fy * v + lens.cy], axis=-1)


def unproject(lens: Lens, pixels: npt.ArrayLike) -> Array:
    """Unit directions [..., 3] in camera axes of pixels [..., 2]; centres at +0.5."""
    at = np.asarray(pixels, np.float64)
    rays = _rays(at.reshape(-1, 2), parameters(lens)).reshape(at.shape)
    directions = np.concatenate([rays, np.ones_like(rays[..., :1])], axis=-1)
    return np.asarray(directions / np.linalg.norm(directions, axis=-1, keepdims=True))

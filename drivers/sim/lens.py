"""A lens with radial and tangential distortion (OpenCV's model), projected and unprojected exactly."""

import numpy as np
import numpy.typing as npt

from drivers.compiling import compiled
from imaging.calibration import Lens

Array = npt.NDArray[np.float64]


@compiled
def distort(x: float, y: float, k1: float, k2: float, p1: float, p2: float) -> tuple[float, float]:
    """Where the lens puts the ray (x, y, 1), in focal lengths from the principal point."""
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
def _undistort_all(points: np.ndarray, terms: np.ndarray) -> np.ndarray:
    rays = np.empty_like(points)
    for i in range(points.shape[0]):
        rays[i, 0], rays[i, 1] = undistort(points[i, 0], points[i, 1], terms[0], terms[1], terms[2], terms[3])
    return rays


def parameters(lens: Lens) -> Array:
    """`fx fy cx cy k1 k2 p1 p2` as float64 [8]."""
    return np.array([lens.fx, lens.fy, lens.cx, lens.cy, lens.k1, lens.k2, lens.p1, lens.p2])


def project(lens: Lens, points: npt.ArrayLike) -> Array:
    """Pixels [..., 2] of points in camera axes [..., 3], z forward and positive."""
    xyz = np.asarray(points, np.float64)
    x, y = xyz[..., 0] / xyz[..., 2], xyz[..., 1] / xyz[..., 2]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (lens.k1 + r2 * lens.k2)
    u = x * radial + 2.0 * lens.p1 * x * y + lens.p2 * (r2 + 2.0 * x * x)
    v = y * radial + 2.0 * lens.p2 * x * y + lens.p1 * (r2 + 2.0 * y * y)
    return np.stack([lens.fx * u + lens.cx, lens.fy * v + lens.cy], axis=-1)


def unproject(lens: Lens, pixels: npt.ArrayLike) -> Array:
    """Unit directions [..., 3] in camera axes of pixels [..., 2]; centres at +0.5."""
    at = np.asarray(pixels, np.float64)
    flat = ((at - (lens.cx, lens.cy)) / (lens.fx, lens.fy)).reshape(-1, 2)
    rays = _undistort_all(flat, parameters(lens)[4:]).reshape(at.shape)
    directions = np.concatenate([rays, np.ones_like(rays[..., :1])], axis=-1)
    return np.asarray(directions / np.linalg.norm(directions, axis=-1, keepdims=True))

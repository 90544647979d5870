"""Points to pixels and pixels to rays through a lens with distortion, in numpy."""

import numpy as np
import numpy.typing as npt

from recon.splat import SplatCamera

Array = npt.NDArray[np.float64]


def project(lens: SplatCamera, xyz: npt.ArrayLike) -> tuple[Array, Array]:
    """World points [..., 3] -> pixels [..., 2] (first centre at 0.5) and depths [...] along the axis.

    OPENCV distortion as in COLMAP. Where the depth is not positive the pixel means nothing.
    """
    motion = lens.cam_from_world
    camera = np.asarray(xyz, np.float64) @ motion[:3, :3].T + motion[:3, 3]
    return project_camera(lens, camera)


def project_camera(lens: SplatCamera, camera: Array) -> tuple[Array, Array]:
    """The same for points [..., 3] in the camera's own axes."""
    depth = camera[..., 2]
    safe = np.where(np.abs(depth) > 1e-12, depth, 1e-12)
    x, y = _distort(lens, camera[..., 0] / safe, camera[..., 1] / safe)
    return np.stack([lens.fx * x + lens.cx, lens.fy * y + lens.cy], -1), depth


def rays(lens: SplatCamera, pixels: npt.ArrayLike) -> Array:
    """Directions [..., 3] with z = 1, in the camera's axes, through pixels [..., 2].

    The distortion is inverted by fixed-point iteration, to 1e-9 for lenses that do not fold over.
    """
    uv = np.asarray(pixels, np.float64)
    goal_x, goal_y = (uv[..., 0] - lens.cx) / lens.fx, (uv[..., 1] - lens.cy) / lens.fy
    x, y = goal_x.copy(), goal_y.copy()
    if lens.k1 or lens.k2 or lens.p1 or lens.p2:
        for _ in range(50):
            at_x, at_y = _distort(lens, x, y)
            error_x, error_y = goal_x - at_x, goal_y - at_y
            x, y = x + error_x, y + error_y
            if max(np.abs(error_x).max(initial=0), np.abs(error_y).max(initial=0)) < 1e-10:
                break
    return np.stack([x, y, np.ones_like(x)], -1)


def lift(lens: SplatCamera, pixels: npt.ArrayLike, depth: npt.ArrayLike) -> Array:
    """World points [..., 3] seen at pixels [..., 2] at depths [...] along the axis."""
    camera = rays(lens, pixels) * np.asarray(depth, np.float64)[..., None]
    motion = lens.cam_from_world
    return np.asarray((camera - motion[:3, 3]) @ motion[:3, :3])


def pixel_centres(lens: SplatCamera) -> Array:
    """The centre of every pixel, [H, W, 2]."""
    x, y = np.meshgrid(np.arange(lens.width) + 0.5, np.arange(lens.height) + 0.5)
    return np.stack([x, y], -1)


def _distort(lens: SplatCamera, x: Array, y: Array) -> tuple[Array, Array]:
    if not (lens.k1 or lens.k2 or lens.p1 or lens.p2):
        return x, y
    square = x * x + y * y
    radial = 1 + square * (lens.k1 + lens.k2 * square)
    cross = 2 * x * y
    return (
        x * radial + lens.p1 * cross + lens.p2 * (square + 2 * x * x),
        y * radial + lens.p2 * cross + lens.p1 * (square + 2 * y * y),
    )

"""Points to pixels and pixels to rays through a lens with distortion, in numpy."""

import numpy as np
import numpy.typing as npt

from imaging.arrays import Array, Mask
from imaging.optics import lens as optics
from recon.splat import SplatCamera


def project(lens: SplatCamera, xyz: npt.ArrayLike) -> tuple[Array, Array]:
    """World points [..., 3] -> pixels [..., 2] (first centre at 0.5) and depths [...] along the axis.

    Distortion as in COLMAP. Where the depth is not positive the pixel means nothing.
    """
    motion = lens.cam_from_world
    camera = np.asarray(xyz, np.float64) @ motion[:3, :3].T + motion[:3, 3]
    return project_camera(lens, camera)


def project_camera(lens: SplatCamera, camera: Array) -> tuple[Array, Array]:
    """The same for points [..., 3] in the camera's own axes."""
    # Component by component: numpy takes several times as long over a last axis of two.
    x, y, depth = camera[..., 0], camera[..., 1], camera[..., 2]
    safe = np.where(np.abs(depth) > 1e-12, depth, 1e-12)
    tangents = np.empty((*depth.shape, 2))
    u, v = np.divide(x, safe, out=tangents[..., 0]), np.divide(y, safe, out=tangents[..., 1])
    if np.isfinite(lens.monotone_radius2):  # beyond it the lens would fold the world back into the image
        radius = np.maximum(np.sqrt(u * u + v * v), 1e-12)
        shrink = np.minimum(1.0, np.sqrt(lens.monotone_radius2) / radius)
        u *= shrink
        v *= shrink
    bent, pixels = lens.distort(tangents), np.empty_like(tangents)
    pixels[..., 0] = bent[..., 0] * lens.fx + lens.cx
    pixels[..., 1] = bent[..., 1] * lens.fy + lens.cy
    return pixels, depth


def inside(lens: SplatCamera, pixels: Array, depth: Array) -> Mask:
    """Return which of `project`ed points a picture shows: those in front of the camera and within its
    bounds.
    """
    x, y = pixels[..., 0], pixels[..., 1]
    within = (depth > 0) & (x >= 0) & (y >= 0) & (x < lens.width) & (y < lens.height)
    return np.asarray(within)


def rays(lens: SplatCamera, pixels: npt.ArrayLike) -> Array:
    """Directions [..., 3] with z = 1, in the camera's axes, through pixels [..., 2].

    The distortion is inverted to 1e-9; a pixel beyond the fold of the lens is taken to lie on it
    (`imaging.optics.lens.undistort`).
    """
    uv = np.asarray(pixels, np.float64)
    bent = (uv - (lens.cx, lens.cy)) / (lens.fx, lens.fy)
    tangents = optics.undistort(bent, lens.lens[4:], fisheye=lens.fisheye)
    return np.concatenate([tangents, np.ones_like(tangents[..., :1])], -1)


def lift(lens: SplatCamera, pixels: npt.ArrayLike, depth: npt.ArrayLike) -> Array:
    """World points [..., 3] seen at pixels [..., 2] at depths [...] along the axis."""
    return lift_along(lens, rays(lens, pixels), depth)


def lift_along(lens: SplatCamera, directions: Array, depth: npt.ArrayLike) -> Array:
    """World points [..., 3] at depths [...] along `rays` [..., 3] of a camera."""
    camera = directions * np.asarray(depth, np.float64)[..., None]
    motion = lens.cam_from_world
    return np.asarray((camera - motion[:3, 3]) @ motion[:3, :3])

"""A camera by the numbers that a file gives of it, checked."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from imaging.errors import InputError
from imaging.optics.lens import FISHEYE_TERMS, WIDEST, Lens, widest_angle
from recon.rendering.cameras.camera_paths import placed
from recon.splat import SplatCamera

MOST_PIXELS = 1 << 15
"""Most pixels on a side."""
_OPENCV_FROM_OPENGL = np.diag([1.0, -1.0, -1.0])
"""Camera axes x right, y up, z back become x right, y down, z forward."""
_ROUNDING = 1e-3
"""Tolerance of the columns of a rotation from unit and orthogonal: files round to few digits."""


def camera_of(
    world_from_camera: npt.ArrayLike, lens: Mapping[str, Any], where: str, *, opengl: bool
) -> SplatCamera:
    """A camera by its pose and the numbers of its lens, checked.

    A camera that is larger or smaller sees the same: what scales its axes alike is left out.

    Args:
        world_from_camera: Pose [4, 4] or [3, 4].
        lens: Fields of `SplatCamera` by name, all but the pose: lengths in px, and the distortion.
        where: Place in a file that errors name.
        opengl: True if the axes of the pose are x right, y up, z back; False for those of OpenCV.

    Returns:
        The camera.

    Raises:
        InputError: The pose is not finite, or it stretches, shears or mirrors; the lens is invalid; the
            picture is too large; or a fisheye sees too far from its axis.
    """
    try:
        motion = np.asarray(world_from_camera, np.float64)
        if motion.shape == (3, 4):
            motion = np.vstack([motion, [0, 0, 0, 1]])
    except (TypeError, ValueError):
        motion = np.zeros(0)
    if motion.shape != (4, 4) or not np.isfinite(motion).all():
        raise InputError(f"{where} has a pose that is not a 4x4 matrix of finite numbers: export it again.")
    turn = motion[:3, :3]
    size = float(np.linalg.norm(turn)) / np.sqrt(3)
    turn = turn / (size or 1.0)
    if np.abs(turn.T @ turn - np.eye(3)).max() > _ROUNDING or np.linalg.det(turn) < 0:
        raise InputError(
            f"{where} has a pose that stretches, shears or mirrors instead of only rotating: correct it."
        )
    turn = turn @ _OPENCV_FROM_OPENGL if opengl else turn
    try:
        camera = SplatCamera(np.eye(4), **lens)
    except (InputError, TypeError, ValueError) as error:
        raise InputError(f"{where} has a lens that cannot be ({error}): correct it.") from error
    if not (camera.width <= MOST_PIXELS and camera.height <= MOST_PIXELS):
        raise InputError(f"{where} has a picture of {camera.width}x{camera.height} pixels: correct it.")
    if camera.fisheye and widest_angle(_lens_of(camera)) > WIDEST:
        raise InputError(
            f"{where} has a fisheye that sees more than {math.degrees(WIDEST):.0f} degrees from its axis, "
            "which rig cannot draw: make its picture smaller."
        )
    return placed(camera, motion[:3, 3], turn)


def _lens_of(camera: SplatCamera) -> Lens:
    """The lens of a fisheye."""
    names = ("width", "height", *FISHEYE_TERMS)
    return Lens(model="OPENCV_FISHEYE", **{name: getattr(camera, name) for name in names})

"""`transforms.json` of nerfstudio and Instant NGP: camera-to-world with OpenGL axes.

Pixel centres are at +0.5 as here. Which lenses are fisheyes nerfstudio reads from `camera_model`, Instant NGP
from `is_fisheye`.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

from imaging.arrays import Array
from imaging.errors import InputError
from imaging.optics.lens import BROWN_TERMS, FISHEYE_TERMS, Lens
from imaging.optics.pose import world_from_opengl

FISHEYE: Final = "OPENCV_FISHEYE"
"""The camera model whose distortion is that of k1, k2, k3 and k4, of the angle from the axis."""
DISTORTION = ("k1", "k2", "k3", "k4", "p1", "p2")
"""Terms in the order in which nerfstudio's `distortion_params` lists them."""
_ALL_TERMS = ("p1", "p2", "k3", "k4", "k5", "k6")
"""Terms that not every model has."""
Number = Callable[[str], float | None]
"""The number of a key; None without it, InputError for anything else."""


def stated_terms(number: Number, *, fisheye: bool) -> tuple[dict[str, float], list[str]]:
    """The terms of the distortion, 0 unless stated, and the names of others that are stated and not 0."""
    names = (FISHEYE_TERMS if fisheye else BROWN_TERMS)[4:]
    others = [key for key in _ALL_TERMS if key not in names and number(key)]
    return {key: number(key) or 0.0 for key in names}, others


def stated_centre(number: Number, width: float, height: float) -> tuple[float, float]:
    """The principal point, px: the middle of the picture unless stated."""
    cx, cy = number("cx"), number("cy")
    return width / 2 if cx is None else cx, height / 2 if cy is None else cy


def stated_focal(
    levels: Sequence[Number], width: float, height: float, where: str, *, fisheye: bool
) -> tuple[float, float] | None:
    """The focal lengths, px, or what a field of view makes of them; one stands for both.

    Args:
        levels: The numbers of a frame, then those of the top of its file: the first that says it counts.
        width: Of the picture, px.
        height: Of the picture, px.
        where: Name of the frame, which begins the sentence of an error.
        fisheye: True for a fisheye, of whose focal length a field of view says nothing without its terms.

    Returns:
        Those across and down; None where nothing is stated.

    Raises:
        InputError: A field of view is no angle between 0 and half a turn, and no focal length stands for it.
    """
    sure = any(number(f"fl_{axis}") for number in levels for axis in "xy")
    fx, fy = (
        next(filter(None, (_focal(number, axis, pixels, where, fisheye, sure) for number in levels)), None)
        for axis, pixels in (("x", width), ("y", height))
    )
    fx, fy = fx or fy, fy or fx
    return None if fx is None or fy is None else (fx, fy)


def _focal(number: Number, axis: str, pixels: float, where: str, fisheye: bool, sure: bool) -> float | None:
    """The focal length along one axis that one level states; sure: one in px is stated somewhere."""
    focal = number(f"fl_{axis}")
    if focal or fisheye:
        return focal
    degrees, angle = number(f"{axis}_fov"), number(f"camera_angle_{axis}")
    if degrees is not None:
        angle = math.radians(degrees)
    if not angle:
        return None
    if 0 < angle < math.pi:
        return pixels / 2 / math.tan(angle / 2)
    if sure:
        return None
    raise InputError(f"{where} has a field of view of {math.degrees(angle):g} degrees: correct it.")


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture and how it was taken. cam_from_world: float64 [4, 4], axes as OpenCV has them."""

    path: str
    lens: Lens
    cam_from_world: Array


def transforms(pictures: Sequence[Picture], coordinates: dict[str, Any]) -> dict[str, Any]:
    """The whole file, of one picture or more; coordinates: what poses are in, in a table of its own, since
    Instant NGP takes an `offset` for its own.
    """
    frames = [_frame(picture) for picture in pictures]
    # One model for all, as nerfstudio reads it; in a rig with lenses of both kinds each frame names its own.
    models = {frame["camera_model"] for frame in frames}
    if len(models) == 1:
        for frame in frames:
            del frame["camera_model"]
    return {
        "camera_model": min(models),
        "is_fisheye": models == {FISHEYE},
        "coordinates": coordinates,
        "frames": frames,
    }


def _frame(picture: Picture) -> dict[str, Any]:
    lens = picture.lens
    return {
        "file_path": picture.path,
        "w": lens.width,
        "h": lens.height,
        "fl_x": lens.fx,
        "fl_y": lens.fy,
        "cx": lens.cx,
        "cy": lens.cy,
        **dict(zip(lens.names[4:], lens.terms[4:], strict=True)),
        "camera_model": FISHEYE if lens.fisheye else "OPENCV",
        "is_fisheye": lens.fisheye,
        "transform_matrix": world_from_opengl(picture.cam_from_world).tolist(),
    }

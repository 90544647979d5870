"""`transforms.json` of nerfstudio and Instant NGP: camera-to-world with OpenGL axes.

Pixel centres are at +0.5 as here. Which lenses are fisheyes nerfstudio reads from `camera_model`, Instant NGP
from `is_fisheye`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from imaging.arrays import Array
from imaging.optics.lens import Lens
from imaging.optics.pose import world_from_opengl


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
        "is_fisheye": models == {"OPENCV_FISHEYE"},
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
        "camera_model": "OPENCV_FISHEYE" if lens.fisheye else "OPENCV",
        "is_fisheye": lens.fisheye,
        "transform_matrix": world_from_opengl(picture.cam_from_world).tolist(),
    }

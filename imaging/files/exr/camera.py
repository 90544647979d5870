"""OpenEXR's own attributes of the camera that took, or drew, a picture."""

from datetime import datetime
from fractions import Fraction

import numpy as np
import OpenEXR

from imaging.arrays import Array
from imaging.files.exr.writing import ExrValue

FILM_MM = 36.0
"""Width of the film that focal lengths are of, mm."""


def camera_attributes(cam_from_world: Array, K: Array, size: tuple[int, int]) -> dict[str, ExrValue]:
    """Attributes of a pinhole; size: (width, height), px. Points are rows before the matrices.

    worldToCamera: into axes x right, y up, z ahead; worldToNDC: into 0..1 from the upper left to the lower
    right of the picture. The focal length is that of a film 36 mm wide.
    """
    onto = np.zeros((4, 4))
    onto[:2, :3], onto[2:, 2] = K[:2] / np.array(size)[:, None], 1
    return {
        "worldToCamera": (np.diag([1.0, -1.0, 1.0, 1.0]) @ cam_from_world).T,
        "worldToNDC": (onto @ cam_from_world).T,
        "pinholeFocalLength": FILM_MM * K[0, 0] / size[0],
    }


def film_attributes(frame: int, rate: float) -> dict[str, ExrValue]:
    """Frame rate and time code of a numbered frame; a rate that is no whole number, or above 60, has none."""
    whole = round(rate)
    attributes: dict[str, ExrValue] = {"framesPerSecond": Fraction(rate).limit_denominator(1001)}
    if whole == rate <= 60:
        seconds, part = divmod(frame, whole)
        hours, rest = divmod(seconds, 3600)
        code = OpenEXR.TimeCode()
        code.hours, code.minutes, code.seconds, code.frame = hours % 24, rest // 60, rest % 60, part
        attributes["timeCode"] = code
    return attributes


def capture_date(taken: datetime) -> dict[str, ExrValue]:
    """Local date of the capture."""
    return {"capDate": taken.strftime("%Y:%m:%d %H:%M:%S")}

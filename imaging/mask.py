"""Masks: pictures that say which pixels of a photograph are to be ignored."""

from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from imaging.errors import InputError


def read_mask(path: Path, height: int, width: int) -> npt.NDArray[np.bool_]:
    """Which pixels count, bool [height, width]: those that are not black, as COLMAP and nerfstudio have it.

    InputError when the file is missing, cannot be read, or is not of the photograph's size.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(
            f"The mask {path} cannot be read ({(error.strerror or 'error').lower()}): "
            "restore it, or import again without masks."
        ) from error
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if data else None
    if image is None:
        raise InputError(f"The mask {path} is damaged: make it again as a PNG, black where to ignore.")
    if image.shape[:2] != (height, width):
        raise InputError(
            f"The mask {path} has {image.shape[1]}x{image.shape[0]} pixels and its photograph "
            f"{width}x{height}: make it of the same size."
        )
    return np.asarray(image[..., :3].any(-1) if image.ndim == 3 else image > 0)

"""A lens as cv2.FileStorage has it: pixel centres at whole numbers, so that `c` is half a pixel less."""

from pathlib import Path

import cv2
import numpy as np

from imaging.arrays import Array
from imaging.files import store
from imaging.optics.lens import Lens

HALF = 0.5
"""Offset of OpenCV's pixel coordinates from ours."""


def write_opencv_lens(path: Path, lens: Lens, cam_from_rig: Array | None = None) -> None:
    """Write a lens, of the `distortion_model` fisheye for cv2.fisheye; StorageError if the disk refuses."""
    # In memory, of YAML: of a path to write to, cv2 takes all after a ? for parameters.
    storage = cv2.FileStorage(".yaml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    storage.write("image_width", lens.width)
    storage.write("image_height", lens.height)
    matrix = [[lens.fx, 0.0, lens.cx - HALF], [0.0, lens.fy, lens.cy - HALF], [0.0, 0.0, 1.0]]
    storage.write("camera_matrix", np.array(matrix))
    storage.write("distortion_model", "fisheye" if lens.fisheye else "plumb_bob")
    storage.write("distortion_coefficients", np.array([list(lens.terms[4:])]))
    if cam_from_rig is not None:
        storage.write("cam_from_rig", cam_from_rig)
    store.write_bytes(path, storage.releaseAndGetString().encode())

"""Small pictures, and the yardstick of every layout: where OpenCV says that a point is seen."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from imaging.files.photo import encode_png
from imaging.session.calibration import CalibrationRecord


@pytest.fixture
def picture() -> Callable[..., bytes]:
    """PNG bytes of noise, another for every seed."""

    def make(seed: int = 0, size: tuple[int, int] = (48, 64)) -> bytes:
        pixels = np.random.default_rng(seed).integers(0, 256, (*size, 3), dtype=np.uint8)
        return encode_png(pixels)

    return make


@pytest.fixture
def put() -> Callable[[Path, bytes], Path]:
    """Write a file and the folders above it."""

    def write(path: Path, data: bytes) -> Path:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
        return path

    return write


@pytest.fixture
def seen_at() -> Callable[..., np.ndarray]:
    """Pixels [P, 2], first centre at +0.5, at which a calibrated view sees world points [P, 3]."""

    def project(record: CalibrationRecord, camera: str, frame: int, xyz: np.ndarray) -> np.ndarray:
        (view,) = (v for v in record.views if (v.camera, v.frame) == (camera, frame))
        lens, motion = record.camera(camera).lens, view.cam_from_world.matrix()
        # OpenCV's first pixel centre is 0.
        inner = np.array([[lens.fx, 0, lens.cx - 0.5], [0, lens.fy, lens.cy - 0.5], [0, 0, 1]])
        turn, terms = cv2.Rodrigues(motion[:3, :3])[0], np.array(lens.terms[4:])
        if lens.model == "OPENCV_FISHEYE":
            pixels, _ = cv2.fisheye.projectPoints(xyz[:, None], turn, motion[:3, 3], inner, terms)
        else:
            pixels, _ = cv2.projectPoints(xyz, turn, motion[:3, 3], inner, terms)
        return pixels.reshape(-1, 2) + 0.5

    return project

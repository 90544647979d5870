"""Falloff of lens and sensitivity, which is divided out of a camera's light."""

import numpy as np

from imaging.arrays import Array32
from imaging.session.calibration import CameraCalibration


def falloff(camera: CameraCalibration, height: int, width: int) -> Array32:
    """Vignetting times gain at every pixel, float32 [height, width]."""
    a, b, c = camera.vignetting
    y = (np.arange(height) + 0.5 - height / 2)[:, None]
    x = (np.arange(width) + 0.5 - width / 2)[None]
    square = (x**2 + y**2) / ((height / 2) ** 2 + (width / 2) ** 2)
    return np.asarray(camera.gain * (1 + a * square + b * square**2 + c * square**3), np.float32).clip(1e-3)

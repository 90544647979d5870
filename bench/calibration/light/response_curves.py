"""Known curves, what is photographed through them, and the estimators that are to find them again."""

from collections.abc import Callable, Sequence
from typing import Any

import cv2
import numpy as np

from calib.light.curves.codes import patches, sample
from calib.light.curves.response import Estimate, estimate
from imaging.arrays import Array, Bytes
from imaging.colour.spaces import srgb_encode
from imaging.merge.linear_frame import decode

FAMILIES: dict[str, Callable[[Array], Array]] = {
    "sRGB": srgb_encode,
    "gamma 2.2": lambda x: x ** (1 / 2.2),
    "BT.709": lambda x: np.where(x < 0.018, 4.5 * x, 1.099 * np.maximum(x, 1e-9) ** 0.45 - 0.099),
    "S-curve": lambda x: 1.21 * x**1.12 / (x**1.12 + 0.21),
    "log": lambda x: np.log1p(60 * x) / np.log(61),
}
LABELS = np.log(4.0 ** np.arange(-3, 4) / 2)
FULL_WELL, READ = 20_000, 6
SITES = 4_000
LEVELS = np.arange(256)
PEERS: dict[str, Callable[[], Any]] = {
    "Debevec": cv2.createCalibrateDebevec,
    "Debevec 500": lambda: cv2.createCalibrateDebevec(500, 10.0, True),
    "Robertson": cv2.createCalibrateRobertson,
}
"""OpenCV's, with their defaults or, beside them, 500 random samples."""


def shoot(curve: Callable[[Array], Array], seed: int, jitter: float, labels: Array = LABELS) -> list[Bytes]:
    """A bracket of codes [240, 320, 3]."""
    rng = np.random.default_rng(seed)
    knots = rng.uniform(np.log(1e-3), np.log(100.0), (7, 10, 3))
    light = np.exp(cv2.resize(knots, (320, 240)) + 0.02 * rng.standard_normal((240, 320, 1)))
    shots = []
    for label in labels:
        mean = np.minimum(light * np.exp(label + jitter * rng.standard_normal()), 2.0) * FULL_WELL
        electrons = rng.poisson(mean) + READ * rng.standard_normal(mean.shape)
        shots.append(np.rint(255 * curve(np.clip(electrons / FULL_WELL, 0, 1))).astype(np.uint8))
    return shots


def ours(shots: Sequence[Bytes], labels: Array) -> Estimate:
    return estimate(sample([patches(shot.astype(np.float32) / 255) for shot in shots], labels, SITES))


def logs_of(estimated: Estimate) -> Array:
    """ln light [256, 3] of the codes."""
    return np.log(
        np.maximum(decode(np.repeat(LEVELS[:, None] / 255, 3, 1), estimated.response), 1e-12)
    ).astype(float)


def truth(curve: Callable[[Array], Array]) -> Array:
    light = np.geomspace(1e-7, 1, 200_000)
    return np.interp(LEVELS / 255, curve(light), np.log(light))


def error(logs: Array, curve: Callable[[Array], Array]) -> float:
    return float((logs - truth(curve)[:, None])[10:246].std(0).max())

"""HDR-Plenoxels' measure of a scene (Jun-Seong et al., ECCV 2022): right halves of photographs.

Exposure and white balance of a tested photograph are not known. As there, they are fitted to its left half:
here one exposure for each channel, of a scene that saw nothing of the photograph.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch

from imaging import metrics
from imaging.arrays import Array, Array32
from imaging.errors import ReconstructionError
from imaging.progress import Progress, unreported
from recon.result.opened import open_model

WIDEST, FINEST = 6.0, 0.01
"""Stops: how far the search of an exposure reaches, and how finely it ends."""


def measure(folder: Path, progress: Progress = unreported) -> dict[str, float]:
    """Mean `psnr` (dB) and `ssim` over the held-out photographs of SESSION/reconstructions/NAME.

    ReconstructionError if it has none, or they are not photographs.
    """
    opened = open_model(folder, progress)
    views = opened.dataset.reported
    if not views or any(view.sensor.kind != "ldr" for view in views):
        raise ReconstructionError(f"{folder} has no held-out photographs: import the scene again.")
    observation, rows = opened.training.method.observation, []
    for done, view in enumerate(views):
        progress("measuring held-out views", done, len(views))
        image, shot = opened.render(view.lens), view.shots[0]

        @torch.no_grad()
        def shown(stops: float, image: Any = image, view: Any = view, k: float = shot.k) -> Array32:
            codes: Array32 = observation.predict(image, view, k * 2.0**stops).clamp(0, 1).numpy()
            return codes

        rows.append(score(shown, shot.pixels))
    return {key: float(np.mean([row[key] for row in rows])) for key in rows[0]}


def score(shown: Callable[[float], Array32], photograph: Array32) -> dict[str, float]:
    """Score the right half of a photograph, codes 0..1 [H, W, 3]: `psnr` (dB) and `ssim`.

    shown: codes [H, W, 3] of the scene at an exposure that many stops off the calibration's. Each channel is
    taken at the exposure at which it comes nearest to the left half.
    """
    half = photograph.shape[1] // 2
    stops = np.zeros(3)
    step = 1.0
    offsets = np.arange(-WIDEST, WIDEST + step / 2, step)
    while step >= FINEST:
        tried = stops + offsets[:, None]
        errors = np.array([_errors(shown, row, photograph, half) for row in tried])
        stops = tried[errors.argmin(0), np.arange(3)]
        step /= 4
        offsets = step * np.arange(-4, 5)
    right = _at(shown, stops)[:, half:], photograph[:, half:]
    similarity = metrics.ssim(*right)
    assert similarity is not None  # no sample is masked
    return {"psnr": metrics.psnr(*right), "ssim": similarity}


def _at(shown: Callable[[float], Array32], stops: Array) -> Array32:
    return np.stack([shown(float(stop))[..., channel] for channel, stop in enumerate(stops)], axis=-1)


def _errors(shown: Callable[[float], Array32], stops: Array, photograph: Array32, half: int) -> Array:
    """Mean squared error [3] of the left half."""
    residual = (_at(shown, stops) - photograph)[:, :half].astype(np.float64)
    return np.asarray((residual**2).mean(axis=(0, 1)))

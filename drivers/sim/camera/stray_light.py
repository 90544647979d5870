"""Veiling glare: light that surfaces of lens and sensor scatter over the whole picture."""

import numpy as np
from scipy.fft import irfft2, rfft2

from imaging.arrays import Array, Floats

NARROW, WIDE = 0.02, 0.3
"""Scales of the two parts, of the image's diagonal: bloom round a lamp, and a veil over everything."""


def scattered(light: Floats, share: float) -> Array:
    """Light [H, W, C] of which `share` falls elsewhere, float64; half of that near by, half far away.

    Each part falls off as `exp(-r / scale)`. What is beyond the picture is as the picture mirrored.
    """
    height, width = light.shape[:2]
    mirrored = np.pad(light, ((0, height), (0, width), (0, 0)), "symmetric").astype(np.float64)
    size = mirrored.shape[:2]
    y, x = (np.minimum(np.arange(side), side - np.arange(side)) for side in size)
    r = np.hypot(y[:, None], x[None]) / np.hypot(height, width)
    kernel = sum(np.exp(-r / scale) / np.exp(-r / scale).sum() for scale in (NARROW, WIDE)) / 2
    spectrum = rfft2(mirrored, axes=(0, 1)) * rfft2(kernel)[..., None]
    spread = irfft2(spectrum, s=size, axes=(0, 1))[:height, :width]
    return np.asarray((1 - share) * light + share * spread)

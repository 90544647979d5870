"""Display values as light: what `Scene.render` has of them, at the exposure of the photographs."""

import numpy as np
import torch

from imaging.arrays import Array
from recon.observe.photographs import DISPLAY_POWER, Display
from recon.result.model import DisplayValues

_STEP = 1 / 512
"""Half of the span of codes over which the slope of a measured response is taken."""


def decoded(codes: Array, display: DisplayValues) -> Array:
    """Codes [..., 3] as light, float64: radiance times `display.k`."""
    observed = Display(display.response, display.k, display.developed)
    return np.asarray(observed.radiance(torch.from_numpy(codes)).double().numpy() * display.k)


def slope(codes: Array, display: DisplayValues) -> Array:
    """Change of `decoded` with codes [..., 3]; of clipped ones that at the end of the scale."""
    inside = codes.clip(0, 1)
    if display.response.kind == "srgb":
        rise = np.where(inside <= 0.04045, 1 / 12.92, 2.4 / 1.055 * ((inside + 0.055) / 1.055) ** 1.4)
    else:
        low, high = (inside - _STEP).clip(0), (inside + _STEP).clip(None, 1)
        rise = (decoded(high, display) - decoded(low, display)) / (high - low)
    if not display.developed:
        return np.asarray(rise)
    # Above 1 light is a power of the code, whatever the response is.
    above = decoded(codes, display) / (DISPLAY_POWER * codes.clip(1))
    return np.asarray(np.where(codes > 1, above, rise))

"""Subjects of a simulated rig: the scene, nothing, a grey surface, a board."""

import numpy as np

from imaging.arrays import Array32
from imaging.optics.lens import Lens

LIGHT = 240.0
"""Radiance of the grey surface, and of white paper beside the board: fills green at f/4, 1/15 s, ISO 100."""


def grey(lens: Lens, radiance: float) -> Array32:
    """A uniform surface that fills the view, float32 [H, W, 3]; radiance 0 is a covered lens."""
    return np.full((lens.height, lens.width, 3), radiance, np.float32)

"""Camera motion between the exposures of a bracket: the shift of each against the next."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy import ndimage

from imaging.arrays import Array
from imaging.merge.linear_frame import LinearFrame
from imaging.sensor.cfa import Cfa

SHAKEN = 0.5
"""Shift between two exposures, px, from which a merge is warned of."""
FEWEST = 0.02
"""Share of the pixels that have to be well exposed in both."""
SURE = 0.1
"""Peak height, of 1, below which two pictures have too little in common to measure a shift."""
SPECK = 5
"""Places in a row, along both axes, that make a hole of what is not valid."""
FADE = 12
"""Places, from a hole on, over which a picture comes to count."""
FAINT, FULL = 0.01, 0.9
"""Signals between which a picture is usable: the lower bound in the shorter exposure, the upper in the
longer.
"""


@dataclass(frozen=True)
class Shift:
    """Shift, px, of a longer exposure's picture against the next shorter one; +x right, +y down.

    k: of the two exposures.
    """

    x: float
    y: float
    k: tuple[float, float]

    @property
    def size(self) -> float:
        """Length, px."""
        return float(np.hypot(self.x, self.y))


def shifts(frames: Sequence[LinearFrame]) -> list[Shift]:
    """Measure the shift between exposures that are neighbours in k; pairs that share too little are left out.

    Phase correlation (Kuglin and Hines 1975) of the logarithms of both, each cut off at what the other
    can see, so that what is saturated in one looks alike in both. Pixels invalid in either do not count.
    """
    ordered = sorted(frames, key=lambda frame: frame.k)
    measured = [_shift(short, long) for short, long in pairwise(ordered)]
    return [shift for shift in measured if shift is not None]


def _shift(short: LinearFrame, long: LinearFrame) -> Shift | None:
    import cv2  # it takes a while to load

    low, high = FAINT / short.k, FULL / long.k
    if not low < high:
        return None
    fade = _fade(short, long)
    pictures = [np.clip(_grey(frame), low, high) for frame in (short, long)]
    if any(np.mean((picture > low) & (picture < high) & (fade > 0)) < FEWEST for picture in pictures):
        return None
    logs = [np.log(picture) for picture in pictures]
    if not fade.all():
        logs = [fade * (log - log[fade > 0].mean()) for log in logs]
    window = cv2.createHanningWindow(logs[0].shape[::-1], cv2.CV_64F)
    (x, y), peak = cv2.phaseCorrelate(logs[0], logs[1], window)
    if peak < SURE:
        return None
    pixels = 1.0 if short.cfa is None else float(short.cfa.cell)
    return Shift(pixels * x, pixels * y, (short.k, long.k))


def _fade(short: LinearFrame, long: LinearFrame) -> Array:
    """Weights 0..1 that fall to 0 where a hole in either picture begins, and at whatever is in it.

    The border of a mask stands still, and would outweigh what moves beside it. Single photosites are no hole.
    """
    unknown = _pixels((short.valid & long.valid).astype(np.float64), short.cfa) < 1.0
    holes = ndimage.binary_opening(unknown, np.ones((SPECK, SPECK), bool))
    if not holes.any():
        return np.ones(holes.shape)
    away = np.minimum(ndimage.distance_transform_edt(~holes) / FADE, 1.0)
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * away))


def _grey(frame: LinearFrame) -> Array:
    """Mean rate of the channels of a pixel, or of the cells of a mosaic."""
    rate = np.where(frame.valid, frame.signal, 0.0).astype(np.float64) / frame.k
    return _pixels(rate, frame.cfa)


def _pixels(values: Array, cfa: Cfa | None) -> Array:
    """Means over the channels of a pixel, or over the cells of a mosaic."""
    if values.ndim == 3:
        return np.asarray(values.mean(-1))
    if cfa is None:
        return values
    cell = cfa.cell
    high, wide = (side // cell for side in values.shape)
    return np.asarray(values[: high * cell, : wide * cell].reshape(high, cell, wide, cell).mean((1, 3)))

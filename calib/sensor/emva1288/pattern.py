"""The fixed pattern of a sensor: how strong it is, in light and in the dark.

Two halves of repeated frames share the pattern and nothing else, so their covariance is the pattern's
variance, without a model of the noise. A mean over 5x5 photosites of the same site is taken off first,
so that neither falling light nor glow counts as pattern.
"""

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from calib.sensor.stack import Stack, sites
from imaging.arrays import Array, Mask

BOX = 5


def photo_response(flat: Stack, dark: Stack | None, black: Array, usable: Mask) -> tuple[float, float] | None:
    """PRNU, relative, and its standard error.

    black: levels [sites]; dark: frames whose pattern is taken off.
    """
    if flat.frames < 2:
        return None
    mask = sites(usable, flat.tile)
    level = _blurred(sites(flat.mean, flat.tile).astype(np.float64) - black[:, None, None], mask)
    halves = [sites(half, flat.tile).astype(np.float64) for half in flat.halves]
    if dark is not None and dark.frames >= 2:
        # Half from half: the noise of one mean of darks would be common to both.
        halves = [
            half - sites(dark_half, flat.tile) for half, dark_half in zip(halves, dark.halves, strict=True)
        ]
    return _strength(halves, mask, level)


def dark_signal(dark: Stack, usable: Mask) -> tuple[float, float] | None:
    """DSNU, DN, and its standard error."""
    if dark.frames < 2:
        return None
    halves = [sites(half, dark.tile).astype(np.float64) for half in dark.halves]
    return _strength(halves, sites(usable, dark.tile), np.ones_like(halves[0]))


def _strength(halves: list[Array], mask: Mask, level: Array) -> tuple[float, float] | None:
    """Strength of the halves relative to a level. It divides last: both have its noise in common."""
    # A photosite beside a defect has fewer neighbours; leaving it out is simpler than its own factor.
    whole = ndimage.minimum_filter(mask, size=(1, BOX, BOX), mode="constant", cval=0)
    if whole.sum() < 500:
        return None
    a, b = (_flattened((half - _blurred(half, mask)) / np.maximum(level, 1e-6), whole) for half in halves)
    remaining = (1.0 - 1.0 / BOX**2) * (1.0 - 1.0 / whole.shape[2])
    common = float((a * b).mean()) / remaining
    error = float(np.sqrt((a.var() * b.var() + (common * remaining) ** 2) / len(a))) / remaining
    value = float(np.sqrt(max(common, 0.0)))
    return value, error / (2.0 * max(value, float(np.sqrt(error))))


def _flattened(planes: Array, whole: npt.NDArray[np.generic]) -> Array:
    """The chosen photosites less the mean of their row, which noise of whole rows moves."""
    count = whole.sum(axis=2, keepdims=True)
    rows = np.where(whole, planes, 0.0).sum(axis=2, keepdims=True) / np.maximum(count, 1)
    return np.asarray((planes - rows)[whole])


def _blurred(planes: Array, mask: npt.NDArray[np.generic]) -> Array:
    """Mean of the usable photosites in a box around each."""
    weight = ndimage.uniform_filter(mask.astype(np.float64), size=(0, BOX, BOX))
    total = ndimage.uniform_filter(np.where(mask, planes, 0.0), size=(0, BOX, BOX))
    return np.asarray(total / np.maximum(weight, 1e-9))

"""The fall of light and levels for the test of linearity, from flats of several exposures."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from calib.sensor.ceiling import MISSING, Ceiling, ceiling
from calib.sensor.linearity import LevelPairs
from calib.sensor.stack import Kind, Stack, Tiles, sites, tiles
from imaging.arrays import Array, Floats, Mask

BINS = 12
"""Levels that the tiles of two flats are gathered in."""


@dataclass(frozen=True)
class FlatFalloff:
    """vignetting: (a, b, c) of `1 + a r^2 + b r^4 + c r^6`, r = 1 at the corner from the centre of the
    image; corner_error: standard error of its value at the corner."""

    vignetting: tuple[float, float, float]
    corner_error: float


def falloff(flat: Stack, black: Array, usable: Mask) -> FlatFalloff | None:
    """The fall of light towards the corners; None if the image is too small.

    A uniform source is rarely quite uniform: a slope across the image is fitted along and left out.
    """
    cut = tiles(flat, usable)
    if len(cut.mean) < 60 or flat.frames < 1:
        return None
    height, width = flat.variance.shape
    x, y = cut.column - width / 2, cut.row - height / 2
    radius = (x**2 + y**2) / ((width / 2) ** 2 + (height / 2) ** 2)
    powers = np.stack([radius, radius**2, radius**3], axis=1)
    light = cut.mean - black[cut.site]
    if not np.all(light > 0):
        return None
    each = (cut.site[:, None] == np.arange(len(black))).astype(np.float64)
    slope = np.stack([x / width, y / height], axis=1)
    values = np.zeros(5 + len(black))
    inverse: Floats = np.eye(len(values))
    weight = light**2 / np.maximum(cut.variance / (cut.count * flat.frames), 1e-9)
    for _ in range(8):
        lens = np.maximum(1.0 + powers @ values[:3], 0.05)
        residual = np.log(light) - np.log(lens) - slope @ values[3:5] - each @ values[5:]
        design = np.concatenate([powers / lens[:, None], slope, each], axis=1)
        inverse = np.linalg.inv(design.T @ (design * weight[:, None]))
        values = values + inverse @ (design.T @ (weight * residual))
    excess = max(float((weight * residual**2).sum()) / (len(light) - len(values)), 1.0)
    error = float(np.sqrt(inverse[:3, :3].sum() * excess))
    a, b, c = (float(value) for value in values[:3])
    return FlatFalloff((a, b, c), error)


def plateau(flats: Sequence[Stack], black: Array, usable: Mask) -> Ceiling | None:
    """Return where the flats end: photosites that have less than shorter flats predict."""
    ordered = sorted(flats, key=lambda flat: flat.time)
    candidates: list[Ceiling] = []
    off = black[:, None]
    for reference in ordered:
        base = _flat(reference.mean, reference) - off
        # The reference must be clear of its own ceiling: at most half of what longer ones reach.
        reached = max(
            float(np.percentile(_flat(flat.mean, flat), 99)) - float(black.mean()) for flat in ordered
        )
        if np.percentile(base, 99) > 0.55 * reached or np.median(base) < 0.05 * reached:
            continue
        for flat in ordered:
            if flat.time > reference.time:
                signal = np.where(_flat(usable, flat), _flat(flat.mean, flat) - off, np.nan)
                one = ceiling(signal, base * (flat.time / reference.time), black)
                if one is not None:
                    full = signal < MISSING * base * (flat.time / reference.time)
                    # The mean of many frames hides how far each of them is from the ceiling.
                    shake = float(np.median(_flat(flat.variance, flat)[full]))
                    candidates.append(Ceiling(one.level, float(np.hypot(one.scatter, np.sqrt(shake)))))
        break
    return min(candidates, key=lambda one: one.scatter, default=None)


def _flat(image: npt.NDArray[Kind], stack: Stack) -> npt.NDArray[Kind]:
    """Photosites of each CFA site of a stack, [sites, N]."""
    planes = sites(image, stack.tile)
    return planes.reshape(len(planes), -1)


def shared_levels(
    flats: Sequence[Stack], black: Array, usable: Mask, white: float, top: float
) -> list[LevelPairs]:
    """Return what neighbouring flats share, for `linearity.straightness`; white, top: DN above black."""
    ordered = sorted(flats, key=lambda flat: flat.time)
    pairs = []
    for short, long in pairwise(ordered):
        a, b = tiles(long, usable), tiles(short, usable)
        bright, dim = a.mean - black[a.site], b.mean - black[b.site]
        # Six standard deviations clear of the ceiling, so that no photosite of the tile is cut.
        good = (bright + 6 * np.sqrt(a.variance) < top) & (bright > 0) & (dim > 0)
        if good.sum() < 20:
            continue
        pairs.append(_binned(bright[good], dim[good], _errors(a, good, long), _errors(b, good, short), white))
    return pairs


def _errors(cut: Tiles, good: Mask, stack: Stack) -> Array:
    """Variance of the mean of each tile, DN^2."""
    return np.asarray((cut.variance / (cut.count * stack.frames))[good])


def _binned(long: Array, short: Array, long_error: Array, short_error: Array, white: float) -> LevelPairs:
    edges = np.quantile(long, np.linspace(0, 1, BINS + 1))
    bin_of = np.clip(np.searchsorted(edges, long, side="right") - 1, 0, BINS - 1)
    count = np.bincount(bin_of, minlength=BINS)

    def mean(values: Array) -> Array:
        return np.asarray(np.bincount(bin_of, values, BINS) / np.maximum(count, 1))

    filled = count > 0
    l_mean, s_mean = mean(long)[filled], mean(short)[filled]
    number = count[filled]
    l_error, s_error = mean(long_error)[filled] / number, mean(short_error)[filled] / number
    return LevelPairs(l_mean / white, s_mean / white, np.sqrt(l_error / l_mean**2 + s_error / s_mean**2))

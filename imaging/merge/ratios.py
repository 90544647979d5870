"""Exposure ratios from what overlapping exposures say, because shutter labels are rounded by construction.

Of two exposures of one view the photosites are chosen by the neighbours of each in the *longer* one:
choosing by both, or by the photosite's own noisy value, would bias the ratio.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from imaging.arrays import Array
from imaging.merge.linear_frame import LinearFrame, SensorSignalNoise
from imaging.robust import huber_weight, robust_scale
from imaging.sensor.cfa import Cfa

LOWEST, HIGHEST = 0.05, 0.9
"""Levels of the longer exposure, relative to white, between which photosites are compared."""
LEVELS = 8
TILES = 16
"""Number of tiles is 16x16 per image, so that what moved or flickered in one part stays apart."""
FEWEST = 500
"""Photosites that two exposures must share."""
LABEL_SIGMA = 0.05
"""Trust in a label, relative."""
SYSTEMATIC = 1e-4
"""Smallest relative error that a ratio is credited with."""


@dataclass(frozen=True, eq=False)
class Overlap:
    """Sums over the photosites that two exposures of one view share; rows are tiles, or levels.

    Columns: signal of the longer, signal of the shorter, variance of the longer, of the shorter
    (with no noise model: the signals again, which has the right shape), number of photosites.
    """

    tiles: Array
    levels: Array

    @property
    def photosites(self) -> float:
        """Number of photosites."""
        return float(self.tiles[:, 4].sum())


def overlap(longer: LinearFrame, shorter: LinearFrame) -> Overlap:
    """Compare two exposures of one view, both of one shape, [H, W] or [H, W, 3]."""
    long, short = longer.signal.astype(np.float64), shorter.signal.astype(np.float64)
    usable = longer.valid & shorter.valid & ~longer.saturated & ~shorter.saturated
    level = _neighbours(np.where(longer.saturated | ~longer.valid, np.inf, long), longer.cfa)
    chosen = usable & (level > LOWEST) & (level < HIGHEST)
    columns = np.stack(
        [long, short, _noise(longer, long), _noise(shorter, short), np.ones_like(long)], axis=-1
    )[chosen]
    rows, cols = (np.arange(n) * TILES // n for n in long.shape[:2])
    tile = (rows[:, None] * TILES + cols[None]).reshape(long.shape[:2] + (1,) * (long.ndim - 2))
    step = np.log(HIGHEST / LOWEST) / LEVELS
    bin_of = np.clip((np.log(level[chosen] / LOWEST) / step).astype(np.intp), 0, LEVELS - 1)
    return Overlap(
        _sums(columns, np.broadcast_to(tile, long.shape)[chosen], TILES * TILES),
        _sums(columns, bin_of, LEVELS),
    )


@dataclass(frozen=True)
class Ratio:
    """Log ratio of the light of two exposures, and its standard error.

    noise: how many times its model (or the shape that stands in for one) the real noise is.
    """

    log: float
    error: float
    noise: float = 1.0


def ratio(overlaps: Sequence[Overlap]) -> Ratio | None:
    """The ratio of two exposures, pooled over views; None when they share too few photosites.

    The ratio of sums is not biased by noise, as a mean of ratios or of logarithms would be; tiles that
    disagree are weighted down (Huber).
    """
    if not overlaps or sum(o.photosites for o in overlaps) < FEWEST:
        return None
    tiles = np.concatenate([o.tiles for o in overlaps])
    tiles = tiles[tiles[:, 4] >= 8]
    long, short = tiles[:, 0], tiles[:, 1]
    if len(tiles) < 4 or not short.sum() > 0:
        return None
    weight = np.ones(len(tiles))
    value = float(long.sum() / short.sum())
    scale = 1.0
    for _ in range(10):
        residual = long - value * short
        spread = np.sqrt(tiles[:, 2] + value**2 * tiles[:, 3])
        whitened = residual / np.maximum(spread, 1e-300)
        scale = robust_scale(whitened) + 1e-12
        weight = huber_weight(whitened, 2.5 * scale)
        total = float((weight * short).sum())
        if not total > 0:
            return None
        value = float((weight * long).sum() / total)
        if not value > 0:
            return None
    error = float(np.sqrt(((weight * (long - value * short)) ** 2).sum()) / (weight * long).sum())
    return Ratio(float(np.log(value)), float(np.hypot(error, SYSTEMATIC)), scale)


def solve(
    labels: Array, edges: Mapping[tuple[int, int], Ratio], prior: float = LABEL_SIGMA
) -> tuple[Array, Array]:
    """Log exposure scales [N] and their standard errors from log labels [N] and ratios between them.

    `edges[i, j]` is log scale i minus log scale j. Labels are trusted to `prior`, relative, and one far
    off the others counts less (Cauchy): they fix the common scale, which no ratio contains, and bridge
    exposures that share no photosites. The errors do not count that of the common scale.
    """
    count = len(labels)
    rows, values, weights = [], [], []
    for (i, j), edge in edges.items():
        row = np.zeros(count)
        row[i], row[j] = 1.0, -1.0
        rows.append(row)
        values.append(edge.log)
        weights.append(1.0 / edge.error)
    design = np.concatenate([np.array(rows).reshape(-1, count), np.eye(count)])
    target = np.concatenate([values, labels])
    scales, trust = labels.copy(), np.ones(count)
    normal = np.eye(count)
    for _ in range(20):
        weight = np.concatenate([weights, trust / prior])[:, None]
        normal = (design * weight).T @ (design * weight)
        scales = np.linalg.solve(normal, (design * weight).T @ (target * weight[:, 0]))
        trust = 1.0 / np.sqrt(1.0 + ((scales - labels) / prior) ** 2)
    centre = np.eye(count) - 1.0 / count
    covariance = centre @ np.linalg.inv(normal) @ centre
    return scales, np.sqrt(np.maximum(np.diag(covariance), 0.0))


@dataclass(frozen=True)
class Linearity:
    """Deviation of a response from a straight line.

    deviation: largest relative departure of a level from the pooled ratio that is not explained by
    noise at two standard errors; raw: the same without allowing for noise.
    """

    deviation: float
    raw: float


def linearity(pairs: Sequence[tuple[Ratio, Sequence[Overlap]]]) -> Linearity | None:
    """Departure from linearity over the levels of all pairs of exposures; None when there is too little."""
    points = []
    for pooled, overlaps in pairs:
        sums = np.sum([o.levels for o in overlaps], axis=0)
        expected = np.exp(pooled.log)
        for long, short, long_var, short_var, number in sums:
            if number < FEWEST / LEVELS or short <= 0:
                continue
            chance = pooled.noise * np.sqrt(long_var + expected**2 * short_var) / long
            error = float(np.hypot(chance, pooled.error))
            if error < 0.01:
                points.append((float(long / short / expected - 1.0), error))
    if not points:
        return None
    departures, errors = np.abs(np.array(points)).T
    return Linearity(float(np.maximum(departures - 2.0 * errors, 0.0).max()), float(departures.max()))


def _neighbours(signal: Array, cfa: Cfa | None) -> Array:
    """Mean of the four neighbours without the photosite itself; in a mosaic those of the same colour, which
    other tables than Bayer's have at any place of the 5x5 around."""
    finite = np.where(np.isfinite(signal), signal, 1e6)  # a saturated neighbour lifts the mean out of range
    if cfa is not None and not cfa.bayer and not cfa.mono:
        return _same_colour(finite, cfa)
    reach = 2 if cfa is not None and cfa.bayer else 1
    cross = np.zeros((2 * reach + 1, 2 * reach + 1))
    cross[0, reach] = cross[-1, reach] = cross[reach, 0] = cross[reach, -1] = 0.25
    if signal.ndim == 2:
        return np.asarray(ndimage.correlate(finite, cross, mode="mirror"))
    return np.stack(
        [ndimage.correlate(finite[..., c], cross, mode="mirror") for c in range(signal.shape[2])], axis=-1
    )


def _same_colour(signal: Array, cfa: Cfa) -> Array:
    """Mean of the photosites of the same colour in the 5x5 around, without the photosite itself."""
    channels, around = cfa.channels(*signal.shape), np.ones((5, 5))
    around[2, 2] = 0.0
    mean = np.empty(signal.shape)
    for channel in range(len(cfa.letters)):
        sites = channels == channel
        total, count = (
            ndimage.correlate(np.where(sites, values, 0.0), around, mode="mirror")
            for values in (signal, np.ones(signal.shape))
        )
        mean[sites] = (total / np.maximum(count, 1.0))[sites]
    return mean


def _noise(frame: LinearFrame, signal: Array) -> Array:
    """Variance of each photosite, unbiased: linear in the signal, so that sums of it are right too."""
    if isinstance(frame.noise, SensorSignalNoise):
        return frame.noise.slope * signal + frame.noise.floor
    return np.maximum(signal, 1e-6)


def _sums(columns: Array, index: npt.NDArray[np.intp], count: int) -> Array:
    return np.stack(
        [np.bincount(index, weights=columns[:, c], minlength=count) for c in range(columns.shape[1])],
        axis=1,
    )

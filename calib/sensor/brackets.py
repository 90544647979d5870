"""A sensor from the brackets of a still scene, where there are no darks and flats.

Two exposures of one view show the same light at two levels, so that `long - ratio short` holds no scene and
no fixed pattern, only noise: `K light (1 + ratio) + floor (1 + ratio^2)`, photon transfer with a scene for a
flat. Photosites are gathered by the level of their neighbours in the longer exposure, never by their own.
What moves or is misaligned adds a variance that grows with the square of the light; it is fitted along, and
where it is not small nothing is said about the gain.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from calib.sensor.ceiling import Ceiling, ceiling
from calib.sensor.linearity import LevelPairs
from calib.sensor.photon_transfer import SMALLEST, Transfer
from calib.sensor.stack import EVEN, Period, sites
from imaging.arrays import Array, Floats, Integers, Mask

EDGES = np.array((0.003, 0.006, 0.012, 0.02, 0.03, 0.045, 0.07, 0.1, 0.15, 0.22, 0.32, 0.45, 0.6, 0.75))
"""Levels relative to white between which photosites are gathered; below the first is a bin too."""
FEWEST = 100
"""Photosites of a bin."""
LOW = 0.25
"""Level, relative to white, up to which black and the ratio are read."""
OUTLIERS = 6.0
"""Standard deviations beyond which a photosite shows something that moved."""
USEFUL = 0.1
"""Largest useful relative error of a gain; of read noise twice that."""
GAIN_SYSTEMATIC, READ_SYSTEMATIC, BLACK_SYSTEMATIC = 0.005, 0.03, 0.01
"""Errors beyond chance, relative, relative and DN: levels are not of one light within a bin; the fixed
pattern of the dark does not cancel, so that a read noise by brackets holds it; rounding."""


@dataclass(frozen=True, eq=False)
class ExposurePair:
    """Two exposures of a view, by bins; float64 [N] each.

    ratio: of the exposures; black: [sites] correction to the black that was assumed, DN, black_error:
    [sites];
    site: of each bin; long, short: mean signals, DN; variance: of `long - ratio short`, DN^2;
    number: of photosites; plateau: where the longer exposure is full.
    """

    ratio: float
    black: Array
    black_error: Array
    site: Integers
    long: Array
    short: Array
    variance: Array
    number: Array
    plateau: Ceiling | None


def compare(
    longer: npt.NDArray[np.integer],
    shorter: npt.NDArray[np.integer],
    black: Array,
    white: float,
    counts: Mask | None = None,
    tile: Period = EVEN,
) -> ExposurePair | None:
    """Two exposures of a view, compared by the level of their photosites.

    Args:
        longer: Longer exposure, DN [H, W].
        shorter: Shorter exposure, DN [H, W].
        black: Black level of each CFA site, DN [sites].
        white: White level, DN, black included.
        counts: Pixels that count in the masks of both, bool [H, W]; None: all.
        tile: Rows and columns of the CFA.

    Returns:
        The pair by bins of level; None where the exposures share too little.
    """
    off = black[:, None, None]
    long, short = (sites(frame, tile).astype(np.float64) - off for frame in (longer, shorter))
    span = white - float(black.mean())
    visible = np.ones(long.shape, bool)
    if counts is not None:
        visible = ndimage.binary_erosion(sites(counts, tile), np.ones((1, 3, 3), bool), border_value=1)
    key = _binned(long, visible, span)
    chosen = key >= 0
    groups, size = key[chosen], len(black) * len(EDGES)
    x, y = long[chosen], short[chosen]
    number = np.bincount(groups, minlength=size)
    good = number >= FEWEST
    if good.sum() < 6:
        return None
    mean_x, mean_y = (np.bincount(groups, v, size)[good] / number[good] for v in (x, y))
    site = np.nonzero(good)[0] // len(EDGES)
    start = float(mean_x.sum() / max(mean_y.sum(), 1e-9))
    if not 1.2 < start < 400:
        return None
    values = np.array([start, *np.zeros(len(black))])
    inverse: Floats = np.eye(len(values))
    variance: Array = np.ones(len(mean_x))
    inliers = clear = counted = np.ones(len(mean_x), bool)
    for _ in range(3):
        residual = x - values[0] * y - values[1 + np.arange(size) // len(EDGES)][groups]
        variance, inliers = _scatter(residual, groups, size)
        variance, inliers = variance[good], inliers[good]
        # Where noise reaches down to 0 DN it is cut off, and mean and variance are not the signal's.
        clear = mean_y + black[site] > 4.0 * np.sqrt(variance) / values[0]
        if clear.sum() < 6:
            return None
        # A response that bends at the top would pull black along.
        low = clear & (mean_x < LOW * span)
        counted = low if low.sum() >= 6 else clear
        weight = counted / np.sqrt(np.maximum(variance, 1e-6) / np.maximum(inliers, 1))
        design = (
            np.concatenate([mean_y[:, None], site[:, None] == np.arange(len(black))], axis=1)
            * weight[:, None]
        )
        inverse = np.linalg.pinv(design.T @ design)
        values = inverse @ (design.T @ (mean_x * weight))
    ratio = float(values[0])
    if not 1.2 < ratio < 400:
        return None
    fitted = np.isin(np.arange(len(black)), site[counted])
    site = site[clear]
    shift = np.where(fitted, values[1:] / (1.0 - ratio), 0.0)
    spread = np.sqrt(np.maximum(np.diag(inverse)[1:], 0.0))  # a site that is not fitted has 0, or just below
    sigma = np.where(fitted, spread / (ratio - 1.0), np.inf)
    predicted = np.where(visible & (short > 0.1 * span), ratio * short, np.nan)
    full = ceiling(long.reshape(len(black), -1), predicted.reshape(len(black), -1), black)
    levels = (mean_x[clear], mean_y[clear], variance[clear], inliers[clear].astype(np.float64))
    return ExposurePair(ratio, shift, sigma, site, *levels, full)


def _binned(long: Array, visible: Mask, span: float) -> Integers:
    """Number of the bin of each photosite [sites, H, W], by the level of its neighbours; -1: in none."""
    cross = np.array(((0, 1, 0), (1, 0, 1), (0, 1, 0)), bool)[None]
    around = ndimage.convolve(long, cross / 4.0, mode="mirror")
    peak = ndimage.maximum_filter(long, footprint=cross, mode="mirror")
    top = min(float(long.max(initial=0.0, where=visible)), span)
    bin_of = np.searchsorted(EDGES * span, around)
    # A photosite brighter than those around it may be full where they are not: in fine texture many are.
    bin_of[(np.maximum(peak, long) > 0.93 * top) | (bin_of == len(EDGES)) | ~visible] = -1
    return np.where(bin_of < 0, -1, np.arange(len(long))[:, None, None] * len(EDGES) + bin_of)


def _scatter(residual: Array, groups: Integers, size: int) -> tuple[Array, Array]:
    """Variance of each group and how many count, without what lies beyond `OUTLIERS`."""
    number = np.maximum(np.bincount(groups, minlength=size), 1)
    # Mean absolute deviation of normal noise is 0.80 standard deviations, and hardly moved by outliers.
    spread = np.bincount(groups, np.abs(residual), size) / number / 0.798
    for _ in range(3):
        inliers = np.abs(residual) < OUTLIERS * spread[groups]
        count = np.maximum(np.bincount(groups[inliers], minlength=size), 1)
        mean = np.bincount(groups[inliers], residual[inliers], size) / count
        square = np.bincount(groups[inliers], residual[inliers] ** 2, size) / count
        spread = np.sqrt(np.maximum(square - mean**2, 1e-12))
    return spread**2, count.astype(np.float64)


@dataclass(frozen=True, eq=False)
class Blind:
    """Sensor parameters from pairs of exposures; None: not determined. black: [sites] correction to the black
    assumed.
    """

    transfer: Transfer | None
    black: Array
    black_error: Array
    plateau: Ceiling | None
    levels: tuple[LevelPairs, ...]
    reason: str
    """Reason why the gain is missing, or empty."""


def pooled(pairs: Sequence[ExposurePair], white: float) -> Blind:
    """All pairs of one camera at one ISO; white: DN above black."""
    weight = np.array([1.0 / pair.black_error**2 for pair in pairs])
    shift = np.array([pair.black for pair in pairs])
    total = weight.sum(0)
    with np.errstate(divide="ignore", invalid="ignore"):
        black = np.where(total > 0, (weight * shift).sum(0) / total, 0.0)
        chi = (weight * (shift - black) ** 2).sum(0) / np.maximum((weight > 0).sum(0) - 1, 1)
        error = np.where(total > 0, np.hypot(np.sqrt(np.maximum(chi, 1.0) / total), BLACK_SYSTEMATIC), np.inf)
    transfer, reason = _transfer(pairs, black)
    levels = tuple(
        LevelPairs(
            (pair.long - black[pair.site]) / white,
            (pair.short - black[pair.site]) / white,
            np.sqrt(pair.variance / pair.number) / np.maximum(pair.long, 1e-9),
        )
        for pair in pairs
    )
    full = [pair.plateau for pair in pairs if pair.plateau is not None]
    plateau = (
        Ceiling(float(np.median([f.level for f in full])), max(f.scatter for f in full)) if full else None
    )
    return Blind(transfer, black, error, plateau, levels, reason)


def _transfer(pairs: Sequence[ExposurePair], black: Array) -> tuple[Transfer | None, str]:
    light = np.concatenate([np.maximum(pair.long - black[pair.site], 0.0) for pair in pairs])
    ratio = np.concatenate([np.full(len(pair.long), pair.ratio) for pair in pairs])
    variance = np.concatenate([pair.variance for pair in pairs])
    number = np.concatenate([pair.number for pair in pairs])
    # Rounding is noise of its own only where other noise covers it, in the shorter exposure too.
    good = variance > SMALLEST * (1 + ratio**2)
    if good.sum() < 6:
        return None, "the sensor quantises too coarsely to show its noise"
    light, ratio, variance, number = light[good], ratio[good], variance[good], number[good]
    design = np.stack([light * (1 + ratio), 1 + ratio**2, light**2], axis=1)
    scale = np.abs(design).max(axis=0)
    expected, values, inverse = variance.copy(), np.zeros(3), np.eye(3)
    columns = 3
    for round_ in range(12):
        part = design[:, :columns] / scale[:columns]
        weight = number / (2.0 * expected**2)
        inverse = np.linalg.pinv(part.T @ (part * weight[:, None]))
        values = inverse @ (part.T @ (weight * variance))
        fitted = part @ values
        expected = np.maximum(fitted, 0.3 * variance)
        if round_ == 5 and columns == 3 and values[2] < 2.0 * np.sqrt(inverse[2, 2]):
            columns = 2
    freedom = max(len(variance) - columns, 1)
    excess = max(float((weight * (variance - fitted) ** 2).sum()) / freedom, 1.0)
    gain, floor = float(values[0] / scale[0]), float(values[1] / scale[1])
    covariance = (inverse * excess)[:2, :2] / np.outer(scale[:2], scale[:2])
    if columns == 3:
        middle = float(np.median(light))
        moved = float(values[2] / scale[2]) * middle**2
        if moved > 0.2 * gain * middle * (1 + float(np.median(ratio))):
            return None, "the exposures of a view differ: something moved"
    if not gain > 0 or np.sqrt(covariance[0, 0]) > USEFUL * gain:
        return None, "the exposures of the views share too little"
    return Transfer(gain, floor, covariance), ""


def read_noise(transfer: Transfer) -> tuple[float, float] | None:
    """Electrons and standard error, None where the error is too large to be of use."""
    value, error = transfer.read_noise()
    error = float(np.hypot(error, READ_SYSTEMATIC * value))
    return (value, error) if transfer.floor > SMALLEST and error < 2 * USEFUL * value else None


def gain(transfer: Transfer) -> tuple[float, float]:
    """DN per electron and standard error."""
    error = float(np.sqrt(transfer.covariance[0, 0]))
    return transfer.gain, float(np.hypot(error, GAIN_SYSTEMATIC * transfer.gain))

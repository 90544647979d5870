"""Exposure ratios of photographs that a camera developed with an unknown curve.

The curve and the exposures are found together, as in Mitsunaga and Nayar ("Radiometric self calibration",
CVPR 99), from differences between neighbouring exposures of smooth patches, in which their light cancels.
One straight line in the logarithm of exposure is indistinguishable from the curve: the labels provide it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from scipy.interpolate import BSpline

from capture.pictures.reduced_pictures import PatchCodes
from imaging.arrays import Array, Mask
from imaging.colour.spaces import srgb_decode
from imaging.merge.ratios import LABEL_SIGMA, Ratio
from imaging.robust import huber_weight, robust_scale

LOWEST, HIGHEST = 5.0, 248.0
"""Mean codes of a patch between which it is used."""
FOG, ABOVE = 40.0, 8.0
"""Scans of film have a floor, up to the first of these; codes are light from the second above it."""
CHANGE = 6.0
"""Codes by which a patch changes over a bracket, if it shows light."""
MOST = 2_000
"""Patches of a bracket."""
BINS = 40
FEWEST = 60
"""Patches that two exposures must share."""
KNOTS = 16
SMOOTHNESS = (1e4, 1e5)
"""Weights of squared third differences; ratios that change with it are trusted less."""
FLOOR = 0.005
"""Disagreement of two exposures, natural log, that no averaging takes away: flicker, glare, development."""
HUBER = 2.5
ROUNDS = 6
GROUPS = 16
"""Number of parts: the picture is cut into 16x16, whose scatter gives the error."""
FEWEST_PARTS, FEWEST_OF_PART = 4, 4
"""Parts that two exposures must share, and patches in each."""


@dataclass(frozen=True, eq=False)
class BracketCodes:
    """Patches of one bracket: code [n, S], 0..255, NaN where of no use; group int [n]: part of the picture.

    labels: [S], ln of the exposures.
    """

    code: Array
    group: npt.NDArray[np.intp]
    labels: Array


def codes_of(bracket: Sequence[PatchCodes], labels: Array) -> BracketCodes:
    """Smooth patches of all brightnesses of one bracket, its exposures in order of `labels`."""
    mean = np.stack([codes.mean for codes in bracket]).astype(np.float64)
    low, high = np.stack([codes.low for codes in bracket]), np.stack([codes.high for codes in bracket])
    floor = max(LOWEST, _fog(mean, labels) + ABOVE)
    inside = (mean >= floor) & (mean <= HIGHEST) & (low >= 0.5) & (high <= 254.5)
    usable = inside.sum(0) >= 2
    # A frame around a scan, or a logo, stays as it is however long is exposed.
    usable &= np.ptp(mean, axis=0) >= CHANGE
    if usable.any():
        rough = (high - low).sum(0)
        usable &= rough <= np.median(rough[usable])
    row, column = np.nonzero(usable)
    level = mean.sum(0)[usable]
    edges = np.linspace(level.min(initial=0.0), level.max(initial=1.0), BINS + 1)
    place = np.clip(np.searchsorted(edges, level) - 1, 0, BINS - 1)
    chosen = [np.flatnonzero(place == index) for index in range(BINS)]
    # As many of each brightness, evenly from its places, since no chance is to change a proof.
    picked = np.concatenate([sites[:: max(1, -(-len(sites) * BINS // MOST))] for sites in chosen])
    parts = (row * GROUPS // usable.shape[0]) * GROUPS + column * GROUPS // usable.shape[1]
    code = np.where(inside, mean, np.nan)[:, row[picked], column[picked]].T
    return BracketCodes(code, parts[picked], labels)


def _fog(mean: Array, labels: Array) -> float:
    """Code below which the two shortest exposures show the same, however long is exposed; 0: none."""
    order = np.argsort(labels, kind="stable")
    if labels[order[1]] - labels[order[0]] < 0.3:
        return 0.0
    shortest, next_one = mean[order[0]], mean[order[1]]
    same = np.abs(shortest - next_one) < CHANGE / 4
    fog = float(np.percentile(shortest[same], 90.0)) if same.mean() > 0.05 else 0.0
    return fog if fog < FOG else 0.0


@dataclass(frozen=True)
class _Pairs:
    """Codes of one patch in two neighbouring exposures; step: the difference of the ln of their labels.

    from_step, to_step: the numbers of the shorter and of the longer shot.
    """

    long: Array
    short: Array
    step: Array
    from_step: npt.NDArray[np.intp]
    to_step: npt.NDArray[np.intp]

    def only(self, keep: Mask) -> "_Pairs":
        """Filter the pairs by `keep`."""
        return _Pairs(
            self.long[keep], self.short[keep], self.step[keep], self.from_step[keep], self.to_step[keep]
        )


@dataclass(frozen=True, eq=False)
class ToneCurves:
    """ln of light against code, at codes 0..255: as fitted, and the stiffer one that it is held against."""

    fitted: Array
    stiff: Array


def curves(brackets: Sequence[BracketCodes]) -> ToneCurves | None:
    """The curve of a camera from its brackets; None where no three different exposures overlap."""
    if not brackets:
        return None
    # Every shot has an exposure of its own: shutters that scatter show more of the curve, not less.
    labels = np.concatenate([codes.labels for codes in brackets])
    first = np.cumsum([0, *(len(codes.labels) for codes in brackets)])
    pairs = [_pairs(codes, int(start)) for codes, start in zip(brackets, first, strict=False)]
    joined = _Pairs(
        np.concatenate([pair.long for pair in pairs]),
        np.concatenate([pair.short for pair in pairs]),
        np.concatenate([pair.step for pair in pairs]),
        np.concatenate([pair.from_step for pair in pairs]),
        np.concatenate([pair.to_step for pair in pairs]),
    )
    # An exposure that shares hardly a patch with any other must not hold the trend of the labels.
    for _ in range(len(labels)):
        count = np.bincount(np.r_[joined.from_step, joined.to_step], minlength=len(labels))
        rare = (count > 0) & (count < FEWEST)
        if not rare.any():
            break
        joined = joined.only(~rare[joined.from_step] & ~rare[joined.to_step])
    used = np.unique(np.r_[joined.from_step, joined.to_step])
    if len(np.unique(labels[used].round(3))) < 3:
        return None
    place = np.searchsorted(used, np.arange(len(labels)))
    joined = replace(joined, from_step=place[joined.from_step], to_step=place[joined.to_step])
    return ToneCurves(*(_fit(joined, labels[used], weight) for weight in SMOOTHNESS))


def edges(codes: BracketCodes, curves: ToneCurves) -> dict[tuple[int, int], Ratio]:
    """Exposure ratios between the neighbours of one bracket: [longer, shorter] by their place in `labels`."""
    ratios = {}
    order = np.argsort(codes.labels, kind="stable")
    for shorter, longer in pairwise(order.tolist()):
        both = np.isfinite(codes.code[:, longer]) & np.isfinite(codes.code[:, shorter])
        if both.sum() < FEWEST:
            continue
        values = [
            np.interp(codes.code[both, longer], np.arange(256.0), curve)
            - np.interp(codes.code[both, shorter], np.arange(256.0), curve)
            for curve in (curves.fitted, curves.stiff)
        ]
        middle, weight = _middle(values[0])
        spread = _spread(values[0], weight, codes.group[both])
        if spread is None:
            continue
        error = float(np.sqrt(spread**2 + FLOOR**2 + (middle - _middle(values[1])[0]) ** 2))
        ratios[longer, shorter] = Ratio(middle, error)
    return ratios


def _middle(values: Array) -> tuple[float, Array]:
    """Mean of the values, and their weights; outliers count less (Huber)."""
    centre, weight = float(np.median(values)), np.ones(len(values))
    for _ in range(5):
        residual = values - centre
        weight = huber_weight(residual, HUBER * (robust_scale(residual) + 1e-9))
        centre = float((weight * values).sum() / weight.sum())
    return centre, weight


def _spread(values: Array, weight: Array, group: npt.NDArray[np.intp]) -> float | None:
    """Standard error of the mean, from the scatter of the parts of the picture; None if they are too few."""
    parts = np.bincount(group) >= FEWEST_OF_PART
    if parts.sum() < FEWEST_PARTS:
        return None
    means = np.bincount(group, weight * values)[parts] / np.bincount(group, weight)[parts]
    return float(np.std(means, ddof=1) / np.sqrt(len(means)))


def _pairs(codes: BracketCodes, first: int) -> _Pairs:
    """Every patch in every two neighbouring exposures that show it; shots are numbered from `first` on."""
    order = np.argsort(codes.labels, kind="stable")
    index = order + first
    shorter, longer = codes.code[:, order[:-1]], codes.code[:, order[1:]]
    patch, pair = np.nonzero(np.isfinite(shorter) & np.isfinite(longer))
    step = np.diff(codes.labels[order])
    return _Pairs(longer[patch, pair], shorter[patch, pair], step[pair], index[1:][pair], index[:-1][pair])


def _design(codes: Array) -> Array:
    """Cubic B-splines [n, KNOTS] over the logarithm of sRGB light, where another exponent is a line."""
    lowest = float(_srgb(np.array([1.0]))[0])
    knots = np.concatenate([[0.0] * 3, np.linspace(0.0, 1.0, KNOTS - 2), [1.0] * 3])
    place = np.clip(1.0 - _srgb(codes) / lowest, 0.0, 1.0)
    return np.asarray(BSpline.design_matrix(place, knots, 3).toarray())


def _srgb(codes: Array) -> Array:
    return np.asarray(np.log(srgb_decode(np.maximum(codes, 1.0) / 255.0)), np.float64)


def _fit(pairs: _Pairs, labels: Array, smoothness: float) -> Array:
    """ln of light at codes 0..255: a spline on top of sRGB, with the exposures free but for their trend."""
    count = len(labels)
    steps = np.zeros((len(pairs.step), count))
    rows = np.arange(len(pairs.step))
    steps[rows, pairs.from_step] -= 1.0
    steps[rows, pairs.to_step] += 1.0
    design = np.hstack([_design(pairs.long) - _design(pairs.short), steps])
    target = pairs.step - (_srgb(pairs.long) - _srgb(pairs.short))
    prior = np.zeros((KNOTS + count, KNOTS + count))
    bend = np.diff(np.eye(KNOTS), 3, axis=0)
    prior[:KNOTS, :KNOTS] = smoothness * bend.T @ bend + 1e-6 * np.eye(KNOTS)
    centred = labels - labels.mean()
    # A trend in the exposures would let the curve shrink to nothing.
    fixed = np.stack([np.ones(count), centred / np.abs(centred).max()])
    prior[KNOTS:, KNOTS:] = np.eye(count) / LABEL_SIGMA**2 + 1e8 * fixed.T @ fixed
    slope = [
        np.gradient(_srgb(np.arange(256.0)))[np.rint(code).astype(int)] for code in (pairs.long, pairs.short)
    ]
    sigma = np.sqrt(0.25 * (slope[0] ** 2 + slope[1] ** 2) + FLOOR**2)
    robust = np.ones(len(target))
    solved = np.zeros(KNOTS + count)
    for _ in range(ROUNDS):
        weighted = design * (robust / sigma**2)[:, None]
        solved = np.linalg.solve(design.T @ weighted + prior, weighted.T @ target)
        robust = huber_weight((target - design @ solved) / sigma, HUBER)
    grid = np.arange(256.0)
    # Where noise made it fall, it stays: a code that is higher is no darker.
    return np.maximum.accumulate(_srgb(grid) + _design(grid) @ solved[:KNOTS])

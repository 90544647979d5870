"""Code values of the same photosites in several exposures: what a response curve is measured from."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from imaging.arrays import Array, Array32, Floats, Integers, Mask

LOWEST, HIGHEST = 5.0, 248.0
"""Mean codes of a patch, of 255, between which it is used: beyond, rounding and clipping bias it."""
CLIPPED = (0.5, 254.5)
"""No code of a patch may lie beyond these. Stricter, and patches would be chosen by their noise."""
FLATTEST = 0.1
"""Rise of ln code a stop below which a code stands on a pedestal."""
BINS = 64
WIDEST = 400
"""Patches in a row, at most."""
FEWEST = 300
"""Photosites below which nothing is measured."""
FOLDS = 3
"""Parts that the groups are divided into, each of which is held out in turn."""


@dataclass(frozen=True, eq=False)
class Samples:
    """Photosites seen in several exposures, of cameras that share a response.

    codes: float64 [N, S, 3], 0..255, NaN where a photosite has no usable code; log_k: [N, S], ln of the
    exposure's label; group: int [N], which part of which view a photosite comes from: the unit held out.
    rough: they are points of the scene seen from several places, whose gloss and edges scatter the codes.
    """

    codes: Array
    log_k: Array
    group: Integers
    rough: bool = False

    @classmethod
    def joined(cls, parts: Sequence["Samples"]) -> "Samples":
        """All photosites of several views; groups are numbered anew, steps padded with NaN.

        Padding has the lowest label of its view: it adds none, and comes between no two exposures.
        """
        steps = max(part.codes.shape[1] for part in parts)
        codes, scales, groups, first = [], [], [], 0
        for part in parts:
            missing = steps - part.codes.shape[1]
            codes.append(np.pad(part.codes, ((0, 0), (0, missing), (0, 0)), constant_values=np.nan))
            lowest = part.log_k.min(initial=np.inf)
            scales.append(np.pad(part.log_k, ((0, 0), (0, missing)), constant_values=lowest))
            groups.append(part.group + first)
            first += int(part.group.max(initial=-1)) + 1
        return cls(np.concatenate(codes), np.concatenate(scales), np.concatenate(groups))


@dataclass(frozen=True, eq=False)
class Patches:
    """A photograph in square patches: mean, smallest and largest code of each, float32 [h, w, 3], 0..255.

    NaN where a patch holds a pixel that a mask hides.
    """

    mean: Array32
    low: Array32
    high: Array32


def patches(pixels: Floats, counts: Mask | None = None) -> Patches:
    """Cut a photograph [H, W, 3], 0..1, into patches of 3x3 pixels, larger ones in larger photographs.

    counts: bool [H, W], the mask of pixels that count; None: all. Patches, because the noise of single
    codes would bend the curve.
    """
    if counts is not None:
        pixels = np.where(counts[..., None], pixels, np.nan)
    size = max(3, pixels.shape[1] // WIDEST)
    height, width = pixels.shape[0] // size, pixels.shape[1] // size
    cut = 255.0 * pixels[: height * size, : width * size].reshape(height, size, width, size, 3)
    return Patches(
        cut.mean((1, 3)).astype(np.float32),
        cut.min((1, 3)).astype(np.float32),
        cut.max((1, 3)).astype(np.float32),
    )


def sample(exposures: Sequence[Patches], log_k: Array, count: int) -> Samples:
    """Choose patches of one view in several exposures: smooth places, all brightnesses alike.

    log_k: [S]; count: how many, at most. Smooth, because at edges compression and the smallest motion change
    a code; of all brightnesses, because the curve has to be known there.
    """
    mean = np.stack([e.mean for e in exposures]).astype(np.float64)
    low, high = np.stack([e.low for e in exposures]), np.stack([e.high for e in exposures])
    inside = (mean >= LOWEST) & (low >= CLIPPED[0]) & (mean <= HIGHEST) & (high <= CLIPPED[1])
    usable = inside.all(-1).sum(0) >= 2
    if usable.any():
        rough = _over_exposures((high - low).mean(-1))
        usable &= rough <= np.median(rough[usable])
    height, width = usable.shape
    # The mean of the codes rises with brightness even where single exposures are clipped.
    picked = _evenly(_over_exposures(mean.mean(-1)).ravel(), np.flatnonzero(usable), count)
    row, column = np.divmod(picked, width)
    return Samples(
        np.where(inside, mean, np.nan).reshape(len(exposures), -1, 3)[:, picked].transpose(1, 0, 2),
        np.broadcast_to(log_k, (len(picked), len(exposures))).copy(),
        (row * 4 // height) * 4 + column * 4 // width,
    )


def _over_exposures(values: Floats) -> Array:
    """Mean [h, w] of values [S, h, w] over the exposures that no mask hides; 0 where all are."""
    finite = np.isfinite(values)
    return np.asarray(np.where(finite, values, 0.0).sum(0) / np.maximum(finite.sum(0), 1), np.float64)


def pedestal(codes: Array, log_k: Array) -> float:
    """Code up to which a channel carries no light: the base of a film, a raised black, flare; 0 without
    one.

    codes, log_k: [N, S] as in `Samples`. Of two exposures of a photosite a stop apart the longer has a code
    that is higher by a fifth or more, whatever the curve; but not on a pedestal.
    """
    order = np.argsort(log_k, axis=1)
    code, stops = (np.take_along_axis(a, order, 1) for a in (codes, log_k / np.log(2.0)))
    long, short, apart = code[:, 1:], code[:, :-1], np.diff(stops, axis=1)
    pairs = np.isfinite(long) & np.isfinite(short) & (apart > 0.2)
    rise = np.log(np.maximum(long, 1.0) / np.maximum(short, 1.0))[pairs] / np.minimum(apart[pairs], 2.0)
    level = long[pairs]
    base = 0.0
    for low in range(0, 128, 2):
        here = rise[(level >= low) & (level < low + 2)]
        if len(here) >= 20 and np.median(here) > FLATTEST:
            break
        if len(here) >= 20:
            base = low + 2.0
    return base


def counting(samples: Samples) -> Mask:
    """Mask of the codes that count, bool [N, S, 3]: between dark and clipped, of sites with two exposures.

    None of a label with few such codes, as of exposures that are nearly black: the fit would have another
    free exposure that hardly a code holds, and with it scale and exponent of the curve. Rough samples keep
    theirs: their exposures are never free.
    """
    codes, log_k = samples.codes, samples.log_k[..., None]
    lowest = [max(LOWEST, pedestal(codes[..., index], samples.log_k)) for index in range(3)]
    used = np.isfinite(codes) & (codes >= lowest) & (codes <= HIGHEST)
    label = np.unique(samples.log_k.round(6), return_inverse=True)[1].reshape(samples.log_k.shape)
    while True:
        span = np.where(used, log_k, -np.inf).max(1) - np.where(used, log_k, np.inf).min(1)
        used &= (span > 0.05)[:, None]
        by_channel = [np.bincount(label[used[..., index]], minlength=label.max() + 1) for index in range(3)]
        count = np.max(by_channel, axis=0)
        few = (count > 0) & (count < min(FEWEST, count.max() / 10))
        if samples.rough or not few.any():
            return used
        used &= ~few[label][..., None]


def _evenly(level: Array, sites: npt.NDArray[np.intp], count: int) -> npt.NDArray[np.intp]:
    """Draw equally many of `sites` from each of the bins between the lowest and the highest level."""
    if not len(sites):
        return sites
    order = sites[np.argsort(level[sites], kind="stable")]
    edges = np.linspace(level[order[0]], level[order[-1]], BINS + 1)
    bounds = np.searchsorted(level[order], edges)
    bounds[-1] = len(order)
    chosen = []
    for low, high in pairwise(bounds.tolist()):
        each = min(max(count // BINS, 1), high - low)
        chosen.append(order[low + np.linspace(0, max(high - low - 1, 0), each).astype(np.intp)])
    return np.unique(np.concatenate(chosen))

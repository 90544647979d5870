"""Code values of the same photosites in several exposures: what a response curve is measured from."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from scipy import ndimage

Array = npt.NDArray[np.float64]

LOWEST, HIGHEST = 5.0, 248.0
"""Mean codes of a patch, of 255, between which it is used: beyond, rounding and clipping bias it."""
CLIPPED = (0.5, 254.5)
"""No code of a patch may lie beyond these. Stricter, and patches would be chosen by their noise."""
BINS = 64


@dataclass(frozen=True, eq=False)
class Samples:
    """Photosites seen in several exposures, of cameras that share a response.

    codes: float64 [N, S, 3], 0..255, NaN where a photosite has no usable code; log_k: [N, S], ln of the
    exposure's label; group: int [N], which part of which view a photosite comes from: the unit held out.
    """

    codes: Array
    log_k: Array
    group: npt.NDArray[np.int64]

    @classmethod
    def joined(cls, parts: Sequence["Samples"]) -> "Samples":
        """All photosites of several views; groups are numbered anew, steps padded with NaN."""
        steps = max(part.codes.shape[1] for part in parts)
        codes, scales, groups, first = [], [], [], 0
        for part in parts:
            missing = steps - part.codes.shape[1]
            codes.append(np.pad(part.codes, ((0, 0), (0, missing), (0, 0)), constant_values=np.nan))
            scales.append(np.pad(part.log_k, ((0, 0), (0, missing))))
            groups.append(part.group + first)
            first += int(part.group.max(initial=-1)) + 1
        return cls(np.concatenate(codes), np.concatenate(scales), np.concatenate(groups))


def sample(codes: npt.NDArray[np.floating], log_k: Array, count: int) -> Samples:
    """Choose photosites of one view: means of smooth 3x3 patches, all brightnesses alike.

    codes: [S, H, W, 3] in 0..255; log_k: [S]; count: how many, at most. Smooth, because at edges compression
    and the smallest motion change a code; patches, because the noise of single codes bends the curve;
    of all brightnesses, because the curve has to be known there.
    """
    steps, height, width, _ = codes.shape
    window = (1, 3, 3, 1)
    mean = ndimage.uniform_filter(codes, window)
    inside = (mean >= LOWEST) & (ndimage.minimum_filter(codes, window) >= CLIPPED[0])
    inside &= (mean <= HIGHEST) & (ndimage.maximum_filter(codes, window) <= CLIPPED[1])
    grey = mean.mean(-1)
    usable = inside.all(-1).sum(0) >= 2
    usable[[0, -1]] = usable[:, [0, -1]] = False
    if usable.any():
        rough = np.sum([ndimage.maximum_filter(g, 5) - ndimage.minimum_filter(g, 5) for g in grey], axis=0)
        usable &= rough <= np.median(rough[usable])
    # The sum of the codes rises with brightness even where single exposures are clipped.
    picked = _evenly(grey.sum(0).ravel(), np.flatnonzero(usable), count)
    row, column = np.divmod(picked, width)
    return Samples(
        np.where(inside, mean, np.nan).reshape(steps, -1, 3)[:, picked].transpose(1, 0, 2),
        np.broadcast_to(log_k, (len(picked), steps)).copy(),
        (row * 4 // height) * 4 + column * 4 // width,
    )


def _evenly(level: Array, sites: npt.NDArray[np.intp], count: int) -> npt.NDArray[np.intp]:
    """As many of `sites` from each of the bins between the lowest and the highest level."""
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

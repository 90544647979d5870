"""True exposures of a bracket, estimated from its pictures of the same view.

An estimate is relative: the common scale of a bracket is that of its labels, of which one that is far off
the others counts less. It is made only where pictures overlap enough to better the label.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from imaging.arrays import Array
from imaging.merge.linear_frame import LinearFrame
from imaging.merge.ratios import Ratio, overlap, ratio, solve
from imaging.optics import dial_settings
from imaging.optics.exposure import Exposure

TRUSTED = 0.02
"""Standard error, relative, above which an estimate is no better than a label, and none is made."""
NEIGHBOURS = 2
"""Largest distance within the bracket of two exposures that are compared: further ones share little."""


@dataclass(frozen=True)
class ExposureEstimate:
    """Estimate of one exposure of a bracket. stops: of the estimate over the label, and over the label's
    exact value.

    error: standard error in stops, of the exposure against the others of its bracket.
    """

    exposure: Exposure
    over_label: float
    over_meant: float
    error: float


def raw_edges(frames: Sequence[LinearFrame], labels: Array) -> dict[tuple[int, int], Ratio]:
    """Exposure ratios between the frames [longer, shorter] of a bracket, linear as the sensor saw them."""
    order = np.argsort(labels, kind="stable").tolist()
    ratios = {}
    for (i, shorter), (j, longer) in combinations(enumerate(order), 2):
        if j - i <= NEIGHBOURS and frames[longer].signal.shape == frames[shorter].signal.shape:
            edge = ratio([overlap(frames[longer], frames[shorter])])
            if edge is not None:
                ratios[longer, shorter] = edge
    return ratios


def estimates(
    exposures: Sequence[Exposure], edges: Mapping[tuple[int, int], Ratio]
) -> list[ExposureEstimate | None]:
    """The exposures of a bracket from their labels and the ratios between them, as logarithms."""
    if not edges:
        return [None] * len(exposures)
    results: list[ExposureEstimate | None] = [None] * len(exposures)
    for group in _linked(len(exposures), edges):
        place = {step: index for index, step in enumerate(group)}
        within = {(place[a], place[b]): edge for (a, b), edge in edges.items() if a in place}
        for step, estimate in zip(group, _solved([exposures[step] for step in group], within), strict=True):
            results[step] = estimate
    return results


def _linked(count: int, edges: Mapping[tuple[int, int], Ratio]) -> list[list[int]]:
    """Exposures that ratios tie together, two or more."""
    rows, columns = zip(*edges, strict=True)
    number, group = connected_components(coo_array((np.ones(len(rows)), (rows, columns)), (count, count)))
    groups = [np.flatnonzero(group == index).tolist() for index in range(number)]
    return [group for group in groups if len(group) > 1]


def _solved(
    exposures: Sequence[Exposure], edges: Mapping[tuple[int, int], Ratio]
) -> list[ExposureEstimate | None]:
    labels = np.log([exposure.scale for exposure in exposures])
    # A shutter's round name may be meant as it is, or for a power of two: whichever explains the pictures.
    trials = [(base, *solve(base, edges)) for base in (labels, meant(exposures))]
    base, scales, errors = min(trials, key=lambda fit: float(np.minimum(np.abs(fit[1] - fit[0]), 0.3).sum()))
    results: list[ExposureEstimate | None] = []
    for exposure, label, intended, scale, error in zip(
        exposures, labels.tolist(), base.tolist(), scales.tolist(), errors.tolist(), strict=True
    ):
        estimated = exposure.with_time(exposure.time * math.exp(scale - label))
        stops = [value / math.log(2) for value in (scale - label, scale - intended, error)]
        results.append(ExposureEstimate(estimated, *stops) if error <= TRUSTED else None)
    return results


def meant(exposures: Sequence[Exposure]) -> Array:
    """Natural logarithms of the exposures with nominal times and f-numbers replaced by powers of two."""
    exact = dial_settings.meant(exposures)
    return np.log([exact[exposure].scale for exposure in exposures])

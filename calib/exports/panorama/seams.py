"""Differences between views where they overlap: the seams that a panorama would show."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from imaging.arrays import Array, Array32
from imaging.session.view_id import ViewId

FEWEST = 30
"""Places at which two views have to be compared."""
LEAST_SNR = 10.0


@dataclass(frozen=True)
class Seam:
    """Two views that overlap: the median of log2(one / other), and its spread between places, stops."""

    one: ViewId
    other: ViewId
    stops: float
    spread: float
    places: int

    def __str__(self) -> str:
        return f"{self.one} {self.other} {self.stops:+.4f} {self.spread:.4f} {self.places}"


def seams(
    views: Sequence[ViewId], compared: Sequence[tuple[Array32, Array32]], luminance: Array
) -> tuple[Seam, ...]:
    """The pairs of views that overlap; compared: light and variance of each on one map.

    luminance: weights [3] of the luminance.
    """
    weights = luminance.astype(np.float32)
    lights = [light @ weights for light, _ in compared]
    sure = []
    for light, (_, variance) in zip(lights, compared, strict=True):
        with np.errstate(invalid="ignore"):
            sure.append(light > LEAST_SNR * np.sqrt(variance @ weights**2))
    results = []
    for one, other in combinations(range(len(views)), 2):
        both = sure[one] & sure[other]
        if both.sum() >= FEWEST:
            stops = np.log2(lights[one][both] / lights[other][both])
            middle = float(np.median(stops))
            spread = 1.4826 * float(np.median(np.abs(stops - middle)))
            results.append(Seam(views[one], views[other], middle, spread, int(both.sum())))
    return tuple(results)

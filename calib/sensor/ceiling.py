"""Saturation level of photosites: nominal white levels are 10 to 15 % off on some makes."""

from dataclasses import dataclass

import numpy as np

from imaging.arrays import Floats

FEWEST = 30
"""Overexposed photosites that a ceiling is read from."""
MISSING = 0.8
"""A photosite with less than this share of the light that another exposure predicts is saturated."""


@dataclass(frozen=True)
class Ceiling:
    """level: DN; scatter: of the saturated photosites around it, DN, rounding included."""

    level: float
    scatter: float


def ceiling(pixels: Floats, predicted: Floats, black: Floats) -> Ceiling | None:
    """The lowest of the plateaus of the CFA sites, from pixels [sites, N] and what they should have, DN.

    Both above black [sites]; NaN marks photosites that are not to be used. None where too few are
    overexposed.
    """
    candidates: list[Ceiling] = []
    for values, expected, off in zip(pixels, predicted, black, strict=True):
        with np.errstate(invalid="ignore"):
            full = values[values < MISSING * expected]
        if len(full) < FEWEST:
            continue
        level = float(np.median(full))
        # What moved between the exposures is as dark as it likes; the plateau is where most of them are.
        near = full[np.abs(full - level) < 0.02 * abs(level) + 2.0]
        if len(near) < 0.8 * len(full):
            continue
        candidates.append(Ceiling(level + float(off), float(np.hypot(near.std(), np.sqrt(1 / 12)))))
    return min(candidates, key=lambda one: one.level, default=None)

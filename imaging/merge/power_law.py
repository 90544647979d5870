"""Detection of a gamma that a camera applied to its RAW mosaics.

Where signal = light ** p, two exposures of a view differ by the same factor at every level, r ** p, as those
of a straight line with other exposures do: only the labels of the exposures distinguish them. Labels
are rounded by a few percent each, and p shows in all pairs in proportion to their distance in stops.
"""

from collections.abc import Sequence

import numpy as np

from imaging.arrays import Array
from imaging.merge.ratios import FEWEST, LEVELS, Overlap

BENT = 0.05
"""Least departure of the exponent from 1 that is called a curve."""
EXPLAINED = 0.3
"""Share of the disagreement with the labels that a curve may leave: one wrong label of three leaves half."""
LIKELIER = 0.5
"""The same of what a wrong black level leaves."""
TOES = np.linspace(-0.5, 0.05, 56)
"""Levels at which a curve may begin, relative to white, black being 0: below it where a gamma takes the black
level for light, or is straight in the dark, as that of sRGB is."""


def exponent(pairs: Sequence[tuple[float, Sequence[Overlap]]]) -> float | None:
    """The power of light that a camera's signal goes with; None where a straight line does as well.

    Args:
        pairs: Of each two exposures, natural log of the ratio that their labels state, longer over shorter,
            and how they overlap in each view.
    """
    rows = []
    for label, overlaps in pairs:
        if label <= 0.0:
            continue
        for long, short, _, _, number in np.sum([one.levels for one in overlaps], axis=0):
            if number >= FEWEST / LEVELS and min(long, short) > 0.0:
                rows.append((label, long / number, short / number))
    if not rows:
        return None
    label, long, short = np.array(rows).T
    straight = _rms(np.log(long / short) - label)
    fits = [_power(label, long - toe, short - toe) for toe in (0.0, *TOES) if toe < 0.9 * short.min()]
    residual, power = fits[0] if fits[0][0] < EXPLAINED * straight else min(fits)
    if (
        abs(power - 1.0) < BENT
        or residual > EXPLAINED * straight
        or residual > LIKELIER * _black(label, long, short)
    ):
        return None
    return power


def _power(label: Array, long: Array, short: Array) -> tuple[float, float]:
    """Return what the likeliest power leaves, and that power."""
    measured = np.log(long / short)
    power = float(label @ measured / (label @ label))
    return _rms(measured - power * label), power


def _black(label: Array, long: Array, short: Array) -> float:
    """Return what remains where the black level is wrong by as much as explains most."""
    step = 1.0 - np.exp(-label)
    offset = float((step * (short - long * np.exp(-label)) / short**2).sum() / (step**2 / short**2).sum())
    expected = (long - offset) * np.exp(-label) + offset
    return _rms(np.log(np.maximum(expected, 1e-6) / short))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))

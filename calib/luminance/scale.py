"""Readings of luminance and what the pictures show of them, as one scale with its standard error."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from imaging.arrays import Array
from imaging.errors import CalibrationError

UNLIKELY = 0.0027
"""Probability, that of three standard deviations, below which readings contradict each other."""


@dataclass(frozen=True)
class Comparison:
    """A reading beside the light that the pictures show in its place.

    name: for messages; known: cd/m2; light: in the unit of the calibration; light_error, stated_error: their
    relative standard errors; source: whose error the stated one is.
    """

    name: str
    known: float
    light: float
    light_error: float
    stated_error: float
    source: str


@dataclass(frozen=True, eq=False)
class Combined:
    """value: cd/m2 per unit of light; error: its standard error; residuals: natural log, of each
    comparison."""

    value: float
    error: float
    residuals: Array


def combined(comparisons: Sequence[Comparison]) -> Combined:
    """The scale that fits all readings best; CalibrationError if they contradict each other.

    Generalised least squares of `ln known - ln light` (Aitken 1935). The errors of the light are independent;
    the stated errors of one source are one error, of which readings that are stated less surely have more of
    their own. Whether the readings agree is a chi-square test of the residuals.
    """
    logs = np.log([one.known / one.light for one in comparisons])
    stated = np.array([one.stated_error for one in comparisons])
    sources = np.array([one.source for one in comparisons])
    together = np.where(sources[:, None] == sources[None], np.minimum(stated[:, None], stated[None]), 0.0)
    covariance = together**2 + np.diag([one.light_error**2 for one in comparisons])
    inverse = np.linalg.inv(covariance)
    variance = 1.0 / float(inverse.sum())
    mean = variance * float((inverse @ logs).sum())
    residuals = logs - mean
    if len(logs) > 1 and special.chdtrc(len(logs) - 1, residuals @ inverse @ residuals) < UNLIKELY:
        raise CalibrationError(_contradiction(comparisons, logs, covariance))
    value = float(np.exp(mean))
    return Combined(value, value * float(np.sqrt(variance)), residuals)


def _contradiction(
    comparisons: Sequence[Comparison],
    logs: Array,
    covariance: Array,
) -> str:
    """The two readings that contradict each other most, beside what their errors allow."""
    variances = np.diag(covariance)
    away = np.abs(logs[:, None] - logs[None])
    allowed = np.sqrt(np.maximum(variances[:, None] + variances[None] - 2 * covariance, 1e-12))
    one, other = sorted(divmod(int(np.argmax(away / allowed)), len(logs)))
    first, second = comparisons[one], comparisons[other]
    return (
        f"the readings of luminance contradict each other: light of 1 is {first.known / first.light:.4g} "
        f"cd/m² by {first.name} and {second.known / second.light:.4g} by {second.name}, "
        f"{_percent(away[one, other])} apart where their errors make {_percent(allowed[one, other])} "
        "likely: correct or leave out the wrong one, or state a larger error."
    )


def _percent(share: float) -> str:
    """Format with two digits, and never as a power of ten."""
    return f"{float(f'{100 * share:.2g}'):g} %"

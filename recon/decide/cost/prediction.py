"""Prediction of a training's held-out quality from a training in miniature.

Quality over the length n of a whole schedule goes as q(n) = end - rise / (1 + (n / half)^power): slowly
while Gaussians look for their places, fastest around `half` iterations, and last by a power law, as learning
curves do (Hestness et al., arXiv 1712.00409). The miniature says where this scene's curve is; the curves of
other scenes how it goes on.
"""

import json
from importlib import resources

import numpy as np
import numpy.typing as npt

from imaging.arrays import Array
from imaging.record import Record


class Prediction(Record):
    """Held-out quality predicted before training, dB: most likely, and an interval for 95 of 100 scenes."""

    db: float
    low: float
    high: float
    iterations: int
    """Iterations of the predicted training, each of one view."""
    tried: int
    """Iterations of the miniature that it comes from."""
    tried_db: float


NOISE = 0.3
"""dB that a training may lie beside its scene's curve."""
SURE = 1.96
"""Standard deviations to either side of a forecast: 95 % of a normal distribution."""

CURVES = "scene_curves.json"


def _scene_curves() -> Array:
    text = resources.files("recon.decide.cost").joinpath(CURVES).read_text(encoding="utf-8")
    return np.array([[row[key] for key in ("ln_rise", "ln_half", "ln_power")] for row in json.loads(text)])


SCENES = _scene_curves()
"""Log rise (dB), log half (iterations), log power of each scene of bench/recon/learning_curves.py, [S, 3]."""


def lacking(curves: Array, iterations: float) -> Array:
    """Shortfall in dB [C] of schedules of that many iterations against the end of the curves [C, 3]."""
    rise, half, power = np.exp(curves.T)
    below: Array = rise / (1 + (iterations / half) ** power)
    return below


def gains(tried: int, iterations: int, scenes: npt.ArrayLike = SCENES) -> Array:
    """dB [S] that a schedule of `iterations` gains over one of `tried`, by the curve of each scene [S, 3]."""
    curves = np.asarray(scenes)
    return lacking(curves, tried) - lacking(curves, iterations)


ENOUGH = 0.08
"""dB that a longer training gains in the mean over scenes, and that early stop does without
(bench/recon/parts/early_stop.py)."""


def enough(iterations: int) -> int:
    """The shortest schedule over which one of `iterations` gains less than `ENOUGH` on the mean of scenes."""
    short, long = 0, iterations
    while long - short > 1:
        middle = (short + long) // 2
        short, long = (short, middle) if gains(middle, iterations).mean() < ENOUGH else (middle, long)
    return long


SLOWER, FASTER = 0.5, 1.5
"""Iterations within a time, over those that fit at the speed of the start: other work may come, or go."""


def predicted(
    db: float, tried: int, iterations: int, scenes: npt.ArrayLike = SCENES, *, timed: bool = False
) -> Prediction:
    """Predict the end of a training, with an interval that holds in 95 of 100.

    Args:
        db: Held-out quality at the end of the miniature's schedule, dB.
        tried: Iterations of that schedule.
        iterations: Of the training that is predicted.
        scenes: Curves [S, 3] as `SCENES` has them.
        timed: True if the training is within a time, so that it may come to fewer iterations, or more.

    Returns:
        Held-out quality and its interval, dB.
    """
    expected, half = _expected(db, tried, iterations, scenes)
    low, high = expected - half, expected + half
    if timed:
        slow, fast = (
            _expected(db, tried, max(round(factor * iterations), 1), scenes) for factor in (SLOWER, FASTER)
        )
        low, high = min(low, slow[0] - slow[1]), max(high, fast[0] + fast[1])
    return Prediction(
        db=round(expected, 2),
        low=round(low, 2),
        high=round(high, 2),
        iterations=iterations,
        tried=tried,
        tried_db=db,
    )


def corrected(guess: Prediction, iterations: int) -> Prediction | None:
    """Return what the miniature says of a training of another length; None if that is about as planned."""
    if SLOWER * guess.iterations <= iterations <= FASTER * guess.iterations:
        return None
    return predicted(guess.tried_db, guess.tried, iterations)


def _expected(db: float, tried: int, iterations: int, scenes: npt.ArrayLike) -> tuple[float, float]:
    """dB, and half the width of its interval."""
    more = gains(tried, iterations, scenes)
    return db + float(more.mean()), SURE * float(np.sqrt(more.var(ddof=1) + 2 * NOISE**2))

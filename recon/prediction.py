"""What held-out quality a training will reach, foretold from a training in miniature.

Quality over the length n of a whole schedule goes as q(n) = end - rise / (1 + (n / half)^power): slowly
while Gaussians look for their places, fastest around `half` iterations, and last by a power law, as learning
curves do (Hestness et al., arXiv 1712.00409). The miniature says where this scene's curve is; the curves of
other scenes how it goes on.
"""

import numpy as np
import numpy.typing as npt

from recon.model import Prediction

Array = npt.NDArray[np.float64]

NOISE = 0.3
"""dB that a training may lie beside its scene's curve."""
SURE = 1.96
"""Standard deviations to either side of a forecast: 95 % of a normal distribution."""

SCENES = (
    (2.63, 3.81, 0.26), (2.75, 3.98, 0.30), (2.55, 3.81, 0.37), (2.57, 3.61, 0.55), (2.74, 3.81, 0.08),
    (2.72, 3.99, 0.31), (2.59, 3.94, 0.38), (2.54, 3.84, 0.28), (2.67, 3.69, 0.26), (2.42, 4.51, 0.49),
    (2.24, 4.08, 0.85), (2.62, 4.56, 0.39), (2.04, 4.52, 0.77), (2.64, 4.62, 0.39), (2.19, 4.13, 0.91),
    (-0.21, 3.48, 1.18), (2.55, 4.51, 0.39), (2.13, 4.56, 0.65), (2.17, 4.62, 0.47), (2.66, 4.60, 0.37),
    (2.63, 4.59, 0.42), (2.51, 4.55, 0.17), (2.28, 4.32, 0.52), (2.64, 4.66, 0.39), (2.83, 4.76, 0.86),
    (2.70, 4.56, 0.35), (2.45, 4.69, 0.73), (2.31, 3.70, 0.35), (2.59, 4.11, 0.69), (1.17, 3.70, 0.57),
)  # fmt: skip
"""Log rise (dB), log half (iterations) and log power of the scenes of bench/learning_curves.py."""


def lacking(curves: Array, iterations: float) -> Array:
    """dB [C] that schedules of so many iterations lie below the end of the curves [C, 3]."""
    rise, half, power = np.exp(curves.T)
    below: Array = rise / (1 + (iterations / half) ** power)
    return below


def predicted(db: float, tried: int, iterations: float, scenes: npt.ArrayLike = SCENES) -> Prediction:
    """The end of a training of `iterations`, with an interval that holds in 95 of 100.

    db: held-out, at the end of a schedule of `tried` iterations. scenes: curves [S, 3] as `SCENES` has them.
    """
    curves = np.asarray(scenes)
    gains = lacking(curves, tried) - lacking(curves, iterations)
    told = db + float(gains.mean())
    half = SURE * float(np.sqrt(gains.var(ddof=1) + 2 * NOISE**2))
    return Prediction(db=round(told, 2), low=round(told - half, 2), high=round(told + half, 2))

"""Linearity of a RAW signal, from exposures that show the same at several levels.

Of two exposures every level gives `long / short = ratio (1 - a long) / (1 - a short)`: the ratio is free, as
shutter labels are rounded and light flickers, and an error of black, which bends the lowest levels only, is
fitted along within its known error. The remainder is the share `a` of the signal that is missing at white.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from imaging.arrays import Array

DEVIATES = 0.008
"""Share at white that has to be exceeded for a signal to count as bent; less is not worth a curve."""
CERTAIN = 4.0
"""Standard errors by which the share has to differ from 0."""
LOWEST = 0.02
"""Level of the longer exposure, relative to white, below which an error of black outweighs a bend."""


@dataclass(frozen=True, eq=False)
class LevelPairs:
    """Levels that two exposures share; float64 [N], relative to white.

    long, short: mean signals; error: standard error of `ln(long / short)`.
    """

    long: Array
    short: Array
    error: Array


@dataclass(frozen=True)
class Straightness:
    """Linearity. share: of the signal missing at white, and its standard error."""

    share: float
    error: float

    @property
    def linear(self) -> bool:
        """True unless the data show otherwise."""
        return abs(self.share) < max(DEVIATES, CERTAIN * self.error)


def straightness(pairs: Sequence[LevelPairs], black_error: float) -> Straightness | None:
    """The bend of a response; black_error: of the black level, relative to white. None if levels lack.

    Levels that are far off all others, as a moving thing makes them, count less (Huber).
    """
    rows, values, weights = [], [], []
    usable = []
    for pair in pairs:
        good = (pair.long > LOWEST) & (pair.short > LOWEST / 20) & (pair.error < 0.05)
        if good.sum() >= 3:
            usable.append(LevelPairs(pair.long[good], pair.short[good], pair.error[good]))
    if not usable:
        return None
    for index, pair in enumerate(usable):
        block = np.zeros((len(pair.long), 2 + len(usable)))
        block[:, 0] = -(pair.long - pair.short)
        block[:, 1] = 1.0 / pair.long - 1.0 / pair.short
        block[:, 2 + index] = 1.0
        rows.append(block)
        values.append(np.log(pair.long / pair.short))
        weights.append(1.0 / pair.error)
    prior = np.zeros((1, 2 + len(usable)))
    prior[0, 1] = 1.0
    design = np.concatenate([*rows, prior])
    target = np.concatenate([*values, [0.0]])
    weight = np.concatenate([*weights, [1.0 / max(black_error, 1e-7)]])
    trust = np.ones(len(weight))
    solution, inverse = np.zeros(design.shape[1]), np.eye(design.shape[1])
    for _ in range(10):
        scaled = design * (weight * np.sqrt(trust))[:, None]
        inverse = np.linalg.pinv(scaled.T @ scaled)
        solution = inverse @ (scaled.T @ (target * weight * np.sqrt(trust)))
        apart = np.abs(target - design @ solution) * weight
        trust = np.minimum(1.0, 2.5 / np.maximum(apart, 1e-12))
    freedom = max(len(weight) - len(usable) - 2, 1)
    excess = max(float((trust * apart**2)[:-1].sum()) / freedom, 1.0)
    return Straightness(float(solution[0]), float(np.sqrt(inverse[0, 0] * excess)))

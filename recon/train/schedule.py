"""The schedule of a training: how far along it each iteration is.

Learning rates, harmonics and growth follow the schedule. A training that is made shorter on the way must
still come to the schedule's end, where the rates are small, so it goes through the rest of it faster.
"""

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Schedule:
    """Position on the schedule after each iteration: straight lines between turns.

    planned: the length of the schedule; a position is 0..planned. turns: (iteration, position), both
    ascending, from (0, 0) to the end, (total, planned). A training that goes as planned has just these two.
    """

    planned: int
    turns: tuple[tuple[int, float], ...]

    @classmethod
    def straight(cls, planned: int) -> "Schedule":
        """Make the planned schedule: one position an iteration."""
        return cls(planned, ((0, 0), (planned, planned)))

    @classmethod
    def still(cls, iterations: int, share: float) -> "Schedule":
        """Make a schedule of iterations that all stand at one share of it, 0..1, for measuring their
        speed.
        """
        return cls(iterations, ((0, share * iterations), (iterations, share * iterations)))

    @classmethod
    def of(cls, turns: Sequence[Sequence[float]]) -> "Schedule":
        """The schedule that was written down as a list of turns."""
        return cls(int(turns[-1][1]), tuple((int(iteration), position) for iteration, position in turns))

    @property
    def total(self) -> int:
        """The last iteration."""
        return self.turns[-1][0]

    def position(self, iteration: int) -> float:
        """Return where the training is when `iteration` iterations are done, 0..planned."""
        index = max(i for i, (since, _) in enumerate(self.turns[:-1]) if since <= max(iteration, 0))
        (since, start), (until, end) = self.turns[index : index + 2]
        if iteration >= until:
            return end
        return start + (iteration - since) * (end - start) / (until - since)

    def progress(self, iteration: int) -> float:
        """The same as a share, 0..1."""
        return self.position(iteration) / self.planned

    def turned(self, iteration: int, rest: int) -> "Schedule":
        """Another schedule from `iteration` on: what is left of this one takes `rest` iterations.

        `rest` is at least 1 while the schedule is not at its end.
        """
        position = self.position(iteration)
        before = tuple(turn for turn in self.turns[:-1] if turn[0] < iteration)
        return Schedule(self.planned, (*before, (iteration, position), (iteration + rest, self.planned)))


USUAL = 2000
POWER = 0.4
"""Exponent of the rates by length. Over the usual rates the light of five scenes gains 4 to 6 dB at 25
iterations, 2 to 4 at 100, 0.6 to 1.3 at 300 and -0.2 to 0.2 at 1000; no other rates that were tried had much
more (bench/results/learning_rates.md).
"""


FAR_USUAL = 300
"""Iterations above which the map of light from far away no longer changes by more in all. Each of its texels
is in few views, whose noise it learns at the rates of the Gaussians: by the preset standard the light of two
yards in single exposures gains 4.0 and 3.2 dB by this, in RAW brackets -2.1 and 2.9, in JPEG brackets -2.6
and 2.7; the darkest tenth of brackets is 0 to 0.06 stops better (`bench/foreign/yards.py`)."""


def rate_factor(iterations: int) -> float:
    """Factor of the learning rates of a whole schedule of `iterations`.

    The rates of the methods are tuned for `USUAL` iterations. In a shorter training parameters would stop on
    the way, in a longer one they would wander about where they should be.
    """
    return float((USUAL / iterations) ** POWER)


def far_rate_factor(iterations: int) -> float:
    """Factor, beside `rate_factor`, of the learning rate of light from far away in `iterations`."""
    return float(min(FAR_USUAL / iterations, 1.0) ** (1 - POWER))

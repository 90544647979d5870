"""A training in miniature before the true one: how fast this machine is, how good the scene gets at once."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

from imaging.progress import Progress, unreported
from recon.data.dataset import Dataset
from recon.decide.cost.duration import slowdown
from recon.train.half_size import UNTIL
from recon.train.monitor import Hooks
from recon.train.schedule import Schedule, rate_factor
from recon.train.trainer import train
from recon.train.training import Plan, Training

FEWEST = 50
"""Iterations that a training within a time has: one that has no room for them is not begun."""
WARM_UP, TRIAL = 2, 3
LATE = 0.7
"""Share of the schedule at which the first iterations are timed: everything is on there that ever is."""
SHARE = 0.08
"""Shares of a time and of a schedule that the miniature may take."""
SHORTEST = 25
"""Iterations of a miniature. Where the time has no room for them, there is no miniature and no prediction."""
GROWTH = 1.25
"""Ratio of the mean time of an iteration in a training to that with the Gaussians it starts with."""
WITH_TRIALS = 2.1
"""Time of a training with its trials, over what its first iterations predict of it without: 1.1 and 0.6 of
two scenes of which only the number of Gaussians is tried, which makes what follows shorter; 1.7 and 2.1 of
two whose poses, exposures and falloff are all in doubt."""
RESERVE = 0.92
"""Share of the time that is planned with: the rest is for measuring, checkpoints and a busier machine."""


@dataclass(frozen=True)
class Probe:
    """Measurements of the miniature.

    iterations: of its schedule. pace: seconds an iteration. db: held-out quality at its end; None without
    held-out views, and where there was no time for a miniature.
    """

    iterations: int
    pace: float
    db: float | None

    def iterations_within(self, seconds: float) -> int:
        """Iterations that fit into `seconds`. The result depends on the machine."""
        return max(int(RESERVE * seconds / self.pace), 0)

    def seconds_for(self, iterations: int) -> float:
        """Time for that many iterations."""
        return iterations * self.pace / RESERVE


def probe(
    begin: Callable[[], Training],
    dataset: Dataset,
    plan: Plan,
    seconds: float | None,
    *,
    progress: Progress = unreported,
    clock: Callable[[], float] = time.monotonic,
) -> Probe:
    """Train to the end of a schedule of some dozen iterations, and discard the result.

    It grows to as many Gaussians and switches on as many harmonics as the one that is planned, so its mean
    pace is that of the true one. If the time is too short for it, a few iterations have to do.

    Args:
        begin: Makes a new training.
        dataset: Views to train on.
        plan: Of the true training.
        seconds: The time in all; None without a limit.
        progress: Callback for the current step, the steps done, and all of them.
        clock: Seconds.

    Returns:
        Pace and held-out quality of the miniature.
    """

    progress("probing the scene", 0, 1)
    count = max(SHORTEST, int(SHARE * plan.iterations))
    if seconds is not None:
        pace = pace_at_once(begin, dataset, plan, clock)
        count = int(min(SHARE * seconds / pace, count))
        if count < SHORTEST:
            return Probe(TRIAL, pace * GROWTH, None)
    training = begin()
    factor = rate_factor(count)
    short = replace(plan, iterations=count, batch=1, log_every=count, measure=True, rate_factor=factor)
    taken = _seconds(training, dataset, short, count, clock)
    pace = max(taken - training.measuring, 1e-9) / count
    return Probe(count, pace, training.curve[-1].db if training.curve else None)


def has_time_for_trials(
    begin: Callable[[], Training],
    dataset: Dataset,
    plan: Plan,
    seconds: float,
    *,
    clock: Callable[[], float] = time.monotonic,
) -> bool:
    """Return whether the whole schedule fits into `seconds` after the trials.

    The result depends on the machine. Arguments as those of `probe`.
    """
    pace = pace_at_once(begin, dataset, plan, clock)
    return WITH_TRIALS * GROWTH * pace * plan.iterations <= RESERVE * seconds


def pace_at_once(
    begin: Callable[[], Training], dataset: Dataset, plan: Plan, clock: Callable[[], float]
) -> float:
    """Seconds an iteration in the mean with as many Gaussians as a training starts with, by a few."""
    # Standing late on the schedule: all harmonics and corrections are on, at full size, and nothing is split.
    count = WARM_UP + TRIAL
    training, short = begin(), Plan(count, plan.density, plan.seed, log_every=count)
    training.schedule = Schedule.still(count, LATE)
    _seconds(training, dataset, short, WARM_UP, clock)
    taken = _seconds(training, dataset, short, count, clock)
    first_half = 1 / slowdown(dataset.train, plan.density.cap)
    return max(taken / TRIAL, 1e-9) * (UNTIL * first_half + 1 - UNTIL)


def _seconds(
    training: Training, dataset: Dataset, plan: Plan, until: int, clock: Callable[[], float]
) -> float:
    began = clock()
    train(training, dataset, plan, Hooks(clock=clock), until=until)
    return clock() - began

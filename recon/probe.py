"""A training in miniature before the true one: how fast this machine is, how good the scene gets at once."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

from recon.dataset import Dataset
from recon.haste import haste
from recon.pixels import Progress
from recon.ranks import Ranks
from recon.trainer import Plan, Training, train

FEWEST = 50
"""Iterations that any training has, however little time there is."""
WARM_UP, TRIAL = 2, 3
SHARE = 0.08
"""Of a time and of a schedule, what the miniature may take."""
SHORTEST = 12
"""Iterations of a miniature. Where the time has no room for them, there is none."""
GROWTH = 1.25
"""How much longer an iteration takes on the mean of a training than with the Gaussians it starts with."""
RESERVE = 0.92
"""Share of the time that is planned with: the rest is for measuring, checkpoints and a busier machine."""

_ALONE = Ranks()


@dataclass(frozen=True)
class Probe:
    """What the miniature told.

    iterations: of its schedule. pace: seconds an iteration. db: held-out quality at its end; None without
    held-out views, and where there was no time for a miniature.
    """

    iterations: int
    pace: float
    db: float | None

    def iterations_within(self, seconds: float) -> int:
        """Iterations that fit into `seconds`, at least 50. The result depends on the machine."""
        return max(FEWEST, int(RESERVE * seconds / self.pace))


def probe(
    begin: Callable[[], Training],
    dataset: Dataset,
    plan: Plan,
    seconds: float | None,
    *,
    ranks: Ranks = _ALONE,
    progress: Progress | None = None,
    clock: Callable[[], float] = time.monotonic,
) -> Probe:
    """Train to the end of a schedule of some dozen iterations, and throw it away.

    It grows to as many Gaussians and switches on as many harmonics as the one that is planned, so its mean
    pace is that of the true one. `begin` makes a new training; `seconds` is the time that there is in all,
    None where time is no matter. If that is too short for it, a few iterations have to do.
    """

    def run(training: Training, plan: Plan, until: int) -> float:
        began = clock()
        train(training, dataset, plan, log=lambda line: None, save=lambda: None, until=until, clock=clock)
        return clock() - began

    if progress:
        progress("probing the scene", 0, 1)
    count = max(SHORTEST, int(SHARE * plan.iterations))
    if seconds is not None:
        # Late in an endless schedule: all harmonics on, no adaptation due.
        warm, endless = begin(), Plan(1_000_000, plan.density, plan.seed, log_every=1_000_000)
        warm.iteration = 700_000
        run(warm, endless, warm.iteration + WARM_UP)
        pace = run(warm, endless, warm.iteration + TRIAL) / TRIAL
        count = int(ranks.told(min(SHARE * seconds / max(pace, 1e-9), count)))
        if count < SHORTEST:
            return Probe(TRIAL, ranks.told(pace) * GROWTH, None)
    training = begin()
    short = replace(plan, iterations=count, batch=1, log_every=count, measure=True, haste=haste(count))
    taken = run(training, short, count)
    pace = max(taken - training.measuring, 1e-9) / count
    return Probe(count, ranks.told(pace), ranks.told(training.curve[-1].db) if training.curve else None)

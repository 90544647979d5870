"""Trainings in miniature before the true one: how fast this machine is, how good the scene gets at once."""

import time
from collections.abc import Callable
from dataclasses import dataclass

from recon.dataset import Dataset
from recon.density import DensityRules
from recon.pixels import Progress
from recon.ranks import Ranks
from recon.trainer import Plan, Training, train

FEWEST = 50
"""Iterations that any training has, however little time there is."""
WARM_UP, TRIAL = 2, 3
SHARE = 0.05
"""Of a time, what the longer miniature may take; the other is half as long."""
SHORTEST, LONGEST = 20, 100
"""Iterations of the longer miniature. Where the time has no room for the shortest, there is none."""
GROWTH = 1.25
"""How much longer an iteration takes on the mean of a training than with the Gaussians it starts with."""
RESERVE = 0.92
"""Share of the time that is planned with: the rest is for measuring, checkpoints and a busier machine."""

_ALONE = Ranks()


@dataclass(frozen=True)
class Probe:
    """What the miniatures told.

    pace: seconds an iteration. db, before: held-out quality after a schedule of `iterations` and after one
    of half as many; None without held-out views, and where there was no time for miniatures.
    """

    iterations: int
    pace: float
    db: float | None
    before: float | None

    def iterations_within(self, seconds: float) -> int:
        """Iterations that fit into `seconds`, at least 50. The result depends on the machine."""
        return max(FEWEST, int(RESERVE * seconds / self.pace))


def probe(
    begin: Callable[[], Training],
    dataset: Dataset,
    cap: int,
    seed: int,
    seconds: float | None,
    *,
    ranks: Ranks = _ALONE,
    progress: Progress | None = None,
    clock: Callable[[], float] = time.monotonic,
) -> Probe:
    """Train to the end of two schedules of some dozen iterations, and throw them away.

    They grow to as many Gaussians and switch on as many harmonics as the true one will, so their mean pace
    is that of the true one. `begin` makes a new training; `seconds` is the time that there is in all, None
    where time is no matter. If that is too short for them, a few iterations have to do.
    """

    def run(training: Training, plan: Plan, until: int) -> float:
        began = clock()
        train(training, dataset, plan, log=lambda line: None, save=lambda: None, until=until, clock=clock)
        return clock() - began

    def miniature(count: int) -> tuple[float, float | None]:
        training = begin()
        taken = run(training, Plan(count, DensityRules(cap), seed, log_every=count, measure=True), count)
        quality = ranks.told(training.curve[-1].db) if training.curve else None
        return max(taken - training.measuring, 1e-9) / count, quality

    if progress:
        progress("probing the scene", 0, 1)
    count = LONGEST
    if seconds is not None:
        # Late in an endless schedule: all harmonics on, no adaptation due.
        warm, endless = begin(), Plan(1_000_000, DensityRules(cap), seed, log_every=1_000_000)
        warm.iteration = 700_000
        run(warm, endless, warm.iteration + WARM_UP)
        pace = run(warm, endless, warm.iteration + TRIAL) / TRIAL
        count = int(ranks.told(min(SHARE * seconds / max(pace, 1e-9), LONGEST)))
        if count < SHORTEST:
            return Probe(TRIAL, ranks.told(pace) * GROWTH, None, None)
    _, before = miniature(count // 2)
    pace, quality = miniature(count)
    return Probe(count, ranks.told(pace), quality, before)

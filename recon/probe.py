"""A training in miniature before the true one: how fast this machine is, and how good the scene starts."""

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
WARM_UP, TRIAL = 6, 6
SHARE = 0.06
"""Of a time, what the miniature may take."""
SHORTEST, LONGEST = 20, 100
RESERVE = 0.92
"""Share of the time that is planned with: the rest is for measuring, checkpoints and a busier machine."""


@dataclass(frozen=True)
class Probe:
    """What the miniature told. pace: seconds an iteration; db: of held-out views, None without such."""

    iterations: int
    pace: float
    db: float | None

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
    ranks: Ranks = Ranks(),  # noqa: B008
    progress: Progress | None = None,
    clock: Callable[[], float] = time.monotonic,
) -> Probe:
    """Train to the end of a schedule of some dozen iterations, and throw it away.

    It grows to as many Gaussians and switches on as many harmonics as the true one will, so its mean pace
    is that of the true one. `begin` makes a new training; `seconds` is the time that there is in all, None
    where time is no matter.
    """

    def run(training: Training, plan: Plan, until: int) -> float:
        began = clock()
        train(training, dataset, plan, log=lambda line: None, save=lambda: None, until=until, clock=clock)
        return clock() - began

    if progress:
        progress("probing the scene", 0, 1)
    count = LONGEST
    if seconds is not None:
        # Late in an endless schedule: all harmonics on, no adaptation due.
        warm, endless = begin(), Plan(1_000_000, DensityRules(cap), seed, log_every=1_000_000)
        warm.iteration = 700_000
        run(warm, endless, warm.iteration + WARM_UP)
        pace = run(warm, endless, warm.iteration + TRIAL) / TRIAL
        count = int(ranks.told(min(max(SHARE * seconds / max(pace, 1e-9), SHORTEST), LONGEST)))
    small = begin()
    # Whole-schedule quality is looked at once, at the end: the period of a long plan is never reached.
    taken = run(small, Plan(count, DensityRules(cap), seed, log_every=count, measure=True), count)
    pace = max(taken - small.measuring, 1e-9) / count
    return Probe(count, ranks.told(pace), ranks.told(small.curve[-1].db) if small.curve else None)

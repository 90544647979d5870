"""How many iterations fit into a time: measured, not guessed."""

import time
from collections.abc import Callable

from recon.dataset import Dataset
from recon.density import DensityRules
from recon.pixels import Progress
from recon.trainer import Plan, Training, train

FEWEST = 50
WARM_UP = 6
TRIAL_SECONDS = 2.5
RESERVE = 0.9
"""Share of the time that is planned with: the rest is for growth, checkpoints and a busier machine."""


def iterations_within(
    seconds: float,
    training: Callable[[], Training],
    dataset: Dataset,
    cap: int,
    progress: Progress | None = None,
) -> int:
    """Iterations that fit into `seconds`, at least 50, from the speed of a trial that is thrown away.

    `training` makes a new training, as it will begin. The trial's own time is taken off. The result
    depends on the machine; it is stored, and the training itself depends on the number alone.
    """
    started = time.monotonic()
    trial = training()
    # Late in an endless schedule: all harmonics on, no adaptation due, and nothing logged.
    trial.iteration = first = 700_000
    plan = Plan(1_000_000, DensityRules(cap), log_every=1_000_000)

    def run(until: int) -> None:
        train(trial, dataset, plan, log=lambda line: None, save=lambda: None, until=until)

    if progress:
        progress("measuring the speed", 0, 1)
    run(first + WARM_UP)
    begun = time.monotonic()
    while time.monotonic() - begun < min(TRIAL_SECONDS, seconds / 10):
        run(trial.iteration + 4)
    speed = max(trial.iteration - first - WARM_UP, 1) / max(time.monotonic() - begun, 1e-6)
    left = seconds - (time.monotonic() - started)
    return max(FEWEST, int(RESERVE * speed * left))

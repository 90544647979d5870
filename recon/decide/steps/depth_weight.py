"""Weight of measured depth in a training: by trials, or by scene points."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch

from imaging.progress import Progress
from imaging.session.records import ONE_OF_SEVERAL, Rung
from recon.data.dataset import Dataset
from recon.data.load import again
from recon.decide.evidence import Evidence, Run
from recon.decide.held_out_evidence import robust_score_db
from recon.decide.settings import Settings
from recon.decide.steps.corrections import TRIAL_GAUSSIANS, TRIAL_LOOKS, TRIAL_SHARE, TRIAL_WIDTH, UNIT
from recon.decide.trials import Trials, room
from recon.train.devices.training_device import CPU

START, TERM = "depth start", "depth term"
WEIGHTS = (0.1, 0.5)
"""Weights that are tried (bench/results/depth.md)."""
USUAL = 0.1
"""The weight where no trial can be made, and there are few views."""
FEW_VIEWS = 12
"""Training views, below which the term is worth it even without a trial: to what the start gains it adds 0.2
to 0.3 dB with six, with twelve and sixteen between -0.1 and 0.4 (bench/results/depth.md)."""
SURE_SCATTER = 0.03
"""Scatter of ln depth about scene points below which depth is accurate enough for that."""


def depth_for(
    run: Run, evidence: Evidence, settings: Settings, against_trials: str | None
) -> tuple[float, tuple[Rung, ...]]:
    """The weight of measured depth in the loss: as asked, else by trials, else by the number of views.

    Without trials the maps have to agree closely with the scene points, too.

    Args:
        run: Running reconstruction.
        evidence: The views, and the fit of their depth maps.
        settings: Of the training; a weight that was set by hand overrides the evidence.
        against_trials: The reason against trials, or None if they are allowed.

    Returns:
        The weight, and the rungs; 0 and no rungs without maps.
    """
    asked, fitted = settings.overrides.depth, evidence.depths
    if fitted is None:
        return 0.0, ()
    if asked == 0:
        return 0.0, (Rung(name=START, taken=False, reason="left out, as asked for"),)
    if not fitted.fits:
        reason = f"{fitted.summary()}: they are of another scene, or in units of their own"
        return 0.0, (Rung(name=START, taken=False, reason=reason),)
    first = Rung(name=START, taken=True, reason=f"in place of a sweep: {fitted.summary()}")
    if asked is not None:
        weight, rung = asked, Rung(name=TERM, taken=True, reason=f"asked for with a weight of {asked:g}")
    elif against_trials is not None:
        sure, count = fitted.scatter <= SURE_SCATTER, len(evidence.dataset.train)
        taken = sure and count < FEW_VIEWS
        weight = USUAL if taken else 0.0
        agreed = f"maps and scene points differ by {'less' if sure else 'more'} than {100 * SURE_SCATTER:g} %"
        views = f"{count} training views are {'few' if count < FEW_VIEWS else 'enough without it'}"
        rung = Rung(name=TERM, taken=taken, reason=f"{agreed}, {views}; a trial: {against_trials}")
    else:
        weight, rung = tried(evidence.dataset, settings, WEIGHTS, run.progress, run.device)
    return weight, (first, rung)


def tried(
    dataset: Dataset,
    settings: Settings,
    weights: Sequence[float],
    progress: Progress,
    device: torch.device = CPU,
) -> tuple[float, Rung]:
    """The best weight, by short trainings without measured depth in the loss and with each weight.

    They are judged on views that none of them saw.

    Args:
        dataset: Views to train on, with depth maps in scene coordinates; one view in four is held out of the
            trials.
        settings: Of the training that is decided on.
        weights: Of measured depth in the loss, each above 0.
        progress: Callback for the current step, the steps done, and all of them.
        device: Device that trains.

    Returns:
        The best weight, 0 if none is better, and its rung.
    """
    if settings.max_width > TRIAL_WIDTH:
        small = again(dataset, TRIAL_WIDTH, progress)
        dataset = replace(settings.overrides.subset(small), watched=dataset.watched)
    most = min(TRIAL_GAUSSIANS, room(dataset))
    trials = Trials.from_new_points(dataset, settings, most // 2, progress, device)
    extent = trials.part.extent
    looks = round(TRIAL_SHARE * settings.iterations * settings.batch)
    iterations = max(TRIAL_LOOKS * len(trials.part.train), looks)

    trials.steps.total = (1 + len(weights)) * iterations

    def scores(weight: float) -> np.ndarray:
        what = f"a trial with measured depth of weight {weight:g}"
        training = trials.trained(iterations, most, what, depth=weight)
        return np.array([robust_score_db(training, view, (), extent) for view in trials.judged])

    without = scores(0.0)
    gains = {weight: scores(weight) - without for weight in weights}
    weight = max(gains, key=lambda weight: float(gains[weight].mean()))
    best = gains[weight]
    rung = Rung.judged(
        TERM,
        float(best.mean()),
        float(best.std(ddof=1) / np.sqrt(len(best))),
        UNIT,
        f"trainings of {iterations} iterations with weights of "
        f"{', '.join(f'{one:g}' for one in (0, *weights))}, judged on {len(best)} views held out of all; "
        f"{weight:g} is best",
        errors=ONE_OF_SEVERAL,
    )
    return weight if rung.taken else 0.0, rung

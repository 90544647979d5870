"""Settings of photographs that the files state as constant, where scene points ask for others.

Of each photograph calibration keeps the factor that scene points ask for, unapplied. Scene points say so of
sheen as well; renders of views that were not trained on decide.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch

from imaging.progress import Progress
from imaging.session.calibration import StatedPart
from imaging.session.records import ONE_OF_SEVERAL, Rung
from recon.data.dataset import Dataset
from recon.data.load import again
from recon.data.stated_factors import PARTS, asked_parts, overruled
from recon.decide.evidence import Evidence, Run
from recon.decide.held_out_evidence import STEPS, robust_score_db
from recon.decide.settings import Settings
from recon.decide.steps.corrections import TRIAL_GAUSSIANS, TRIAL_LOOKS, TRIAL_SHARE, TRIAL_WIDTH, UNIT
from recon.decide.trials import Steps, Trials, room
from recon.start.initialisation import colours_at
from recon.train.devices.training_device import CPU


def overruled_parts(
    run: Run, evidence: Evidence, against_trials: str | None
) -> tuple[tuple[StatedPart, ...], tuple[Rung, ...]]:
    """The parts in which scene points overrule the files: as requested, else by trials.

    Args:
        run: Running reconstruction; parts that were set by hand override the evidence.
        evidence: The views, whose calibration has the factors that scene points ask for.
        against_trials: The reason against trials, or None if they are allowed.

    Returns:
        The parts, and a rung for each part that was considered.
    """
    asks = asked_parts(evidence.dataset)
    wanted = run.asked.overrides.overrule
    if wanted is not None:
        chosen = wanted.split("+")
        rungs = {part: _rung(part, False, "left out, as asked for") for part in asks}
        none = "scene points ask for no other than what the files state"
        for part in (part for part in PARTS if part in chosen):
            rungs[part] = _rung(part, part in asks, "asked for" if part in asks else none)
    elif against_trials is not None:
        rungs = {part: _rung(part, False, against_trials) for part in asks}
    else:
        rungs = tried(evidence.dataset, asks, run.asked, run.progress, run.device)
    taken = tuple(part for part in asks if rungs[part].taken)
    return taken, tuple(rungs[part] for part in PARTS if part in rungs)


def in_words(dataset: Dataset, part: StatedPart, rung: Rung) -> str:
    """One sentence on a part that was taken, with its size in the training views."""
    train = {view.id for view in dataset.train}
    views = [view for view in dataset.calibration.views if view.id in train]
    asked = [view.exposure_asked if part == "exposure" else view.white_balance_asked for view in views]
    logs = np.log([factors for factors in asked if factors is not None])
    why = "as asked for"
    if rung.gain is not None:
        why = f"and held-out views get {rung.gain:.2g} ± {rung.standard_error:.1g} dB better with it"
    return (
        f"the {_name(part)} that the files state as the same for all photographs differs by "
        f"{100 * np.sqrt(np.mean(logs**2)):.2g} % by scene points, {why}: these overrule the files "
        "(--set overrule=none keeps what the files state)."
    )


def tried(
    dataset: Dataset,
    parts: Sequence[StatedPart],
    settings: Settings,
    progress: Progress,
    device: torch.device = CPU,
) -> dict[StatedPart, Rung]:
    """Judge the parts by short trainings, on views that none of these saw.

    One is as the files state it, and there is one more with the factors of each part after the other.

    Args:
        dataset: Views to train on; one view in four is held out of the trials.
        parts: Parts to try, in order; a part that is taken stays in the trials of the next.
        settings: Of the training that is decided on.
        progress: Callback for the current step, the steps done, and all of them.
        device: Device that trains.

    Returns:
        A rung for each part.
    """
    small = dataset
    if settings.max_width > TRIAL_WIDTH:
        small = again(dataset, TRIAL_WIDTH, progress)
    # Methods form images of photographs that differ from their labels in another way, through their falloff,
    # too. All trainings do so as if they differed: what is judged is the factors alone.
    known = overruled(small, parts).calibration
    most = min(TRIAL_GAUSSIANS, room(small))
    steps = Steps()

    def alike(chosen: Sequence[StatedPart]) -> Dataset:
        return replace(overruled(small, chosen), calibration=known)

    # One sweep for all: trainings from other places would differ by more than these factors gain.
    plain = Trials.from_new_points(alike(()), settings, most // 2, progress, device)
    plain = replace(plain, steps=steps)

    def started(chosen: Sequence[StatedPart]) -> Trials:
        trials = Trials.of(alike(chosen), settings, plain.points, progress, device)
        rgb, _ = colours_at(trials.part, trials.images, plain.points.xyz)
        return replace(trials, points=replace(plain.points, rgb=rgb), steps=steps)

    judged, extent = plain.judged, plain.part.extent
    looks = round(TRIAL_SHARE * settings.iterations * settings.batch)
    iterations = max(TRIAL_LOOKS * len(plain.part.train), looks)
    steps.total = (1 + len(parts)) * (iterations + STEPS * len(judged))

    def scores(trials: Trials, what: str) -> np.ndarray:
        # A factor of the judged view itself was found in its own pixels: applied in one of the trainings only
        # it would fit that view better whatever the scene is. So the view is as its files state it in all,
        # and gets in each a gain of each channel, fitted to one half of its pixels and judged on the other.
        # What is left is how well the trained photographs agree on the scene, place by place.
        training = trials.trained(iterations, most, f"a trial with {what}")
        one_by_one = []
        for view in judged:
            one_by_one.append(robust_score_db(training, view, ["gains"], extent))
            trials.fitted(STEPS, f"judging {what}")
        return np.array(one_by_one)

    best, taken = scores(plain, "what the files state"), list[StatedPart]()
    rungs: dict[StatedPart, Rung] = {}
    for part in parts:
        freed = scores(started([*taken, part]), f"{_name(part)} of each photograph")
        gains = freed - best
        rungs[part] = Rung.judged(
            f"{_name(part)} against the files",
            float(gains.mean()),
            float(gains.std(ddof=1) / np.sqrt(len(gains))),
            UNIT,
            f"two trainings of {iterations} iterations, judged on {len(judged)} views held out of both, "
            "after a gain of each channel",
            errors=ONE_OF_SEVERAL,
        )
        if rungs[part].taken:
            taken, best = [*taken, part], freed
    return rungs


def _name(part: StatedPart) -> str:
    return part.replace("_", " ")


def _rung(part: StatedPart, taken: bool, reason: str) -> Rung:
    return Rung(name=f"{_name(part)} against the files", taken=taken, reason=reason)

"""Corrections that a training may make: by the errors of the calibration, else by the evidence of a trial."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import get_args

import numpy as np
import torch

from imaging.errors import InputError
from imaging.progress import Progress
from imaging.session.calibration import CalibrationRecord, Response
from imaging.session.records import ONE_OF_SEVERAL, Rung
from recon.data.dataset import Dataset, View
from recon.data.geometry import inside, project
from recon.data.load import again
from recon.decide.evidence import Evidence, Run
from recon.decide.held_out_evidence import STEPS, robust_score_db
from recon.decide.overrides import Overrides
from recon.decide.presets import MethodName
from recon.decide.settings import Settings
from recon.decide.steps.stray_light import glare_of
from recon.decide.trials import Trials, room
from recon.methods import vanilla
from recon.observe.refinement import Refined, Refinement
from recon.train.devices.training_device import CPU
from recon.train.training import Training

ALL: tuple[Refined, ...] = get_args(Refined)
TRIED: tuple[Refined, ...] = ("poses", "exposures", "vignetting")
"""Corrections decided by trials, where the calibration does not state errors; glare is measured on scene
points.
"""
KNOWN_PX = 0.3
"""Pose error, in pixels of the training images, below which a correction has next to nothing to gain, and no
trial can measure it (bench/recon/parts/refine.py).
"""
KNOWN_PERCENT = 1.0
"""And exposures that are surer than this."""
TRIAL_WIDTH = 320
TRIAL_GAUSSIANS = 10_000
TRIAL_LOOKS = 20
"""Fewest iterations a view in a trial; the corrections need that many to converge."""
TRIAL_SHARE = 0.2
"""Smallest share of the training's own iterations."""
UNIT = "dB of the residuals of views held out of a trial"


@dataclass(frozen=True)
class Corrections:
    """Corrections that a training makes.

    rungs: the reasons for and against each of `ALL`. scattered: share of the light that the lens of each
    camera scatters at the start.
    """

    names: tuple[Refined, ...] = ()
    rungs: tuple[Rung, ...] = ()
    scattered: tuple[float, ...] = ()

    def begun(self, dataset: Dataset) -> Refinement:
        """Return them as they are when a training begins."""
        return Refinement.of(dataset, self.names, self.rungs, torch.tensor(self.scattered))


UNCORRECTED = Corrections()


def corrections_for(
    run: Run, evidence: Evidence, settings: Settings, against_trials: str | None
) -> Corrections:
    """Return the corrections of a training with these settings: as requested, else by evidence.

    Args:
        run: Running reconstruction.
        evidence: The views, with their calibration.
        settings: Of the training; corrections that were set by hand override the evidence.
        against_trials: The reason against trials, or None if they are allowed.

    Returns:
        The corrections, with a rung for each of `ALL`.
    """
    asked, dataset = settings.overrides.refine, evidence.dataset
    shares, glare = glare_of(dataset, evidence.images)
    if asked is not None:
        rungs = [_as_asked(name, dataset, settings) for name in ALL]
    else:
        known = _displayed(dataset, settings.method, "glare") or glare
        rungs = [*rungs_by_evidence(dataset, settings, against_trials, run.progress, run.device), known]
    taken = tuple(name for name, rung in zip(ALL, rungs, strict=True) if rung.taken)
    return Corrections(taken, tuple(rungs), tuple(shares))


def require_light(dataset: Dataset, method: MethodName, overrides: Overrides) -> None:
    """InputError where corrections of the light are asked for, with a method that takes display values as
    they are.
    """
    names = [name for name in ALL if name in (overrides.refine or "") and _displayed(dataset, method, name)]
    if names:
        raise InputError(
            f"Display values, which --method {method} trains on, have no {names[0]} to correct: use --method "
            f"hdr-gs, or leave {' and '.join(names)} out of --set refine."
        )


def _as_asked(name: Refined, dataset: Dataset, settings: Settings) -> Rung:
    """The rung of a correction where they are set by hand."""
    if name not in (settings.overrides.refine or ""):
        return _rung(name, False, "not asked for")
    return _displayed(dataset, settings.method, name) or _rung(name, True, "asked for")


def rungs_by_evidence(
    dataset: Dataset,
    settings: Settings,
    against_trials: str | None,
    progress: Progress,
    device: torch.device = CPU,
) -> list[Rung]:
    """A rung for each of `TRIED`, in order: by the calibration, else by a trial, else not taken."""
    rungs = {name: _without_trial(name, dataset, settings.method) for name in TRIED}
    undecided = [name for name in TRIED if rungs[name] is None]
    if undecided and against_trials is not None:
        rungs |= {name: _rung(name, False, against_trials) for name in undecided}
    elif undecided:
        small = dataset
        if settings.max_width > TRIAL_WIDTH:
            small = again(dataset, TRIAL_WIDTH, progress)
        rungs |= tried(small, undecided, settings, progress, device)
    return [rung for rung in rungs.values() if rung is not None]


def tried(
    dataset: Dataset,
    names: Sequence[Refined],
    settings: Settings,
    progress: Progress,
    device: torch.device = CPU,
) -> dict[Refined, Rung]:
    """A short training without corrections and one with each of `names`, judged on views that none saw.

    Args:
        dataset: Views to train on; one view in four is held out of the trials.
        names: Corrections to try, each alone.
        settings: Of the training that is decided on.
        progress: Callback for the current step, the steps done, and all of them.
        device: Device that trains.

    Returns:
        A rung for each of `names`.
    """
    most = min(TRIAL_GAUSSIANS, room(dataset))
    trials = Trials.from_new_points(dataset, settings, most // 2, progress, device)
    part, judged, extent = trials.part, trials.judged, trials.part.extent
    looks = round(TRIAL_SHARE * settings.iterations * settings.batch)
    iterations = max(TRIAL_LOOKS * len(part.train), looks)

    def ended(chosen: Sequence[Refined], message: str) -> Training:
        return trials.trained(iterations, most, message, refine=chosen)

    fits = {name: 2 * STEPS if name in ("poses", "exposures") else 0 for name in names}
    trials.steps.total = (1 + len(names)) * iterations + sum(fits.values()) * len(judged)
    plain = ended((), "a trial without corrections")
    rungs: dict[Refined, Rung] = {}
    for name in names:
        freed = ended((name,), f"a trial with corrected {name}")
        gains = []
        for view in judged:
            scores = (robust_score_db(training, view, [name], extent) for training in (freed, plain))
            gains.append(next(scores) - next(scores))
            trials.fitted(fits[name], f"judging corrected {name}")
        rungs[name] = Rung.judged(
            f"refine {name}",
            float(np.mean(gains)),
            float(np.std(gains, ddof=1) / np.sqrt(len(gains))),
            UNIT,
            f"two trainings of {iterations} iterations, judged on {len(judged)} views held out of both",
            errors=ONE_OF_SEVERAL,
        )
    return rungs


def _without_trial(name: Refined, dataset: Dataset, method: str) -> Rung | None:
    """The rung, where it is decided without a trial."""
    calibration = dataset.calibration
    if name == "poses":
        px = pose_error_px(dataset)
        if px is not None and px < KNOWN_PX:
            return _rung(
                name, False, f"the calibration's poses are sure to {px:.2f} px of the training images"
            )
        return None
    if (rung := _displayed(dataset, method, name)) is not None:
        return rung
    if name == "exposures":
        percent = _exposure_error_percent(calibration, dataset.train)
        if percent is not None and percent < KNOWN_PERCENT:
            return _rung(name, False, f"overlapping exposures determine their ratios to {percent:.2g} %")
        return None
    measured = next((rung for rung in calibration.rungs if rung.name == "vignetting" and rung.gain), None)
    if measured is not None:
        falloff = "a falloff" if measured.taken else "no falloff"
        return _rung(name, False, f"the calibration found {falloff} on scene points that several views share")
    return None


def _displayed(dataset: Dataset, method: str, name: Refined) -> Rung | None:
    """Rung of corrections of the light, with methods that do not separate it from display values."""
    if name != "poses" and dataset.kind == "ldr" and method == vanilla.NAME:
        return _rung(name, False, "display values are taken as they are, with no idea of light")
    return None


def pose_error_px(dataset: Dataset) -> float | None:
    """Median over the training views of the effect of their pose errors, px; None if unknown.

    Standard errors of rotation and of place are added, the one at the view's focal length, the other at its
    median depth. A view of which no error is known counts as infinitely wrong.
    """
    errors = {view.id: view.error for view in dataset.calibration.views}
    model = dataset.points()
    if not len(model.xyz) or not any(errors.values()):
        return None
    errors_px = []
    for view in dataset.train:
        error = errors.get(view.id)
        if error is None:
            errors_px.append(np.inf)
            continue
        pixels, depth = project(view.lens, model.xyz)
        shown = inside(view.lens, pixels, depth)
        away = dataset.world.unit * (float(np.median(depth[shown])) if shown.any() else dataset.extent)
        errors_px.append(view.lens.fx * (np.radians(error.rotation) + error.translation / away))
    median = float(np.median(errors_px))
    return median if np.isfinite(median) else None


def _exposure_error_percent(calibration: CalibrationRecord, views: Sequence[View]) -> float | None:
    """Return how sure the ratios of exposures are; None where no overlaps measured them."""
    rungs = {rung.name: rung for rung in calibration.rungs}
    ratios, per_shot = rungs.get("exposure_ratios"), rungs.get("exposure_per_shot")
    labels = rungs.get("exposure_labels")
    judged = labels is not None and labels.gain is not None
    developed = [view.sensor.response for view in views if view.sensor.kind == "ldr"]
    curve_errors = [_curve_error(response, judged) for response in dict.fromkeys(developed)]
    percents = [100 * error for error in curve_errors if error is not None]
    if len(percents) < len(curve_errors):
        return None
    if len(developed) < len(views):
        if ratios is None or not ratios.taken or ratios.standard_error is None or per_shot is None:
            return None
        scatter = 0.0 if per_shot.taken else per_shot.gain or 0.0
        percents.append(max(ratios.standard_error, scatter))
    return float(max(percents))


def _curve_error(response: Response, judged: bool) -> float | None:
    """Return the error, natural log, of exposures taken from a curve; None if it was not measured.

    The curve's own error where its exposures were judged apart from their labels; elsewhere the disagreement
    of its exposures, most of which is noise.
    """
    if not judged or not response.sigma:
        return response.residual
    codes = np.asarray(response.codes)
    valid = (codes >= response.valid[0]) & (codes <= response.valid[1])
    return float(np.median(np.asarray(response.sigma)[:, valid])) if valid.any() else response.residual


def _rung(name: Refined, taken: bool, reason: str) -> Rung:
    return Rung(name=f"refine {name}", taken=taken, reason=reason)

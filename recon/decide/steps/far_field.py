"""Decision on light from far away behind the Gaussians: by geometry first, then by a trial."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch

from imaging.errors import ReconstructionError
from imaging.progress import Progress
from imaging.session.records import Rung
from recon.data.dataset import Dataset
from recon.data.light import Images
from recon.data.load import again
from recon.decide.evidence import Evidence, Run
from recon.decide.held_out_evidence import robust_score_db
from recon.decide.settings import Settings
from recon.decide.steps.corrections import UNIT
from recon.decide.trials import HELD_OUT, Trials, room
from recon.methods import vanilla
from recon.start.far_light import far_light, looked_through
from recon.start.initialisation import Start, colours_at
from recon.start.plane_sweep import plane_sweep, sample
from recon.train.devices.training_device import CPU

NAME = "environment"
SUGGESTED, SURE = 0.05, 0.16
"""Shares of the swept points through which views see the light of far away: below the first no far field is
taken; above it a trial decides, and where none can be made, the second, of measured light. Yards before a sky
have 15 to 29 %, objects before a light probe 23, a room with lamps and mirrors 3
(bench/foreign/far_share.py); but photographs of one exposure, taken as display values, lose by one on five of
five sets, a castle with 23 % 2.2 dB (bench/real/far_field.py)."""
ROWS = 128
"""Rows of the map that is compared with for it."""
FEWEST_SWEPT, MOST_VIEWS, MOST_POINTS = 200, 8, 2000
"""Swept points below which views are swept again: at most this number of views, for this number of points."""
TRIAL_WIDTH, TRIAL_GAUSSIANS, TRIAL_LOOKS, MOST_ITERATIONS = 160, 5000, 40, 400
"""Pixels, Gaussians, iterations a view and in all, of a trial. With ten looks a far field, which is soon
trained, seems worth 2.5 dB to a castle and to a flight that lose by it; with forty the castle loses 2.5."""
ERRORS = 0.0
"""Standard errors that the gain of a trial has to exceed: the views' agreement on far light has spoken for it
before. Scenes that need it gain 0.2 to 1.2 dB, and one exposure a view differs more between views than that;
scenes that lose by it lose 0.2 to 3.4 dB in the trial (bench/real/far_field.py, bench/foreign/yards.py)."""
FEWEST_JUDGED = 2
"""Views held out of a trial: its gains and losses are larger than those of other trials."""


def environment_for(
    run: Run,
    evidence: Evidence,
    settings: Settings,
    points: Start,
    units: Callable[[torch.Tensor], torch.Tensor],
    against_trials: str | None,
) -> Rung:
    """Decide on an environment: as asked, else by geometry, and by a trial where that suggests one.

    Args:
        run: Running reconstruction.
        evidence: The views, with their radiance images.
        settings: Of the training; an environment that was set by hand overrides the evidence.
        points: Those that training would start from.
        units: Radiance as images of the scene hold it, as of `far_light`.
        against_trials: The reason against trials, or None if they are allowed.

    Returns:
        Rung of the environment, with the reason.

    Raises:
        ReconstructionError: An environment was asked for, and the light is that of bands.
    """
    asked, dataset = settings.overrides.environment, evidence.dataset
    if dataset.bands:
        if asked:
            raise ReconstructionError(
                f"{dataset.session} has the light of bands, and an environment that of Rec.709: leave "
                "--set environment=1 out."
            )
        return Rung(name=NAME, taken=False, reason="the light is that of bands, which it does not have")
    if asked is not None:
        return Rung(name=NAME, taken=asked, reason="asked for" if asked else "left out, as asked for")
    if all(view.transparent for view in dataset.train):
        reason = "where the photographs are transparent there is nothing"
        return Rung(name=NAME, taken=False, reason=reason)
    share = far_share(dataset, evidence.images, points, units)
    return _by_share(dataset, settings, share, against_trials, run.progress, run.device)


def _by_share(
    dataset: Dataset,
    settings: Settings,
    share: float,
    against_trials: str | None,
    progress: Progress,
    device: torch.device,
) -> Rung:
    reason = (
        f"through {100 * share:.0f} % of the points in front of the cameras views see light from far away"
    )
    if share < SUGGESTED:
        return Rung(name=NAME, taken=False, reason=f"{reason}: too few for a far field")
    if len(dataset.train) < FEWEST_JUDGED * HELD_OUT:
        against_trials = (
            f"{len(dataset.train)} training views are too few to hold {FEWEST_JUDGED} of them out"
        )
    if against_trials is None:
        return tried(dataset, settings, reason, progress, device)
    if dataset.kind == "ldr" and settings.method == vanilla.NAME:
        why = f"display values need one only if a trial says so; no trial: {against_trials}"
        return Rung(name=NAME, taken=False, reason=f"{reason}; {why}")
    return Rung(name=NAME, taken=share > SURE, reason=f"{reason}; no trial: {against_trials}")


def far_share(
    dataset: Dataset, images: Images, points: Start, units: Callable[[torch.Tensor], torch.Tensor]
) -> float:
    """Share of the swept points at which views rather see the light from far away; 0 without any.

    Two views agree on the light of a direction before a plain wall as before a sky, and more so the smoother
    it is; but at a wall they agree on that of a place as well.
    """
    if len(points.xyz) - points.sparse < FEWEST_SWEPT:
        maps = plane_sweep(dataset.train, images, points.xyz, most=MOST_VIEWS)
        xyz = sample(maps, MOST_POINTS, np.random.Generator(np.random.PCG64(0)))
        rgb, visible = colours_at(dataset, images, xyz)
        points = Start(xyz[visible], rgb[visible], 0)
    swept = len(points.xyz) - points.sparse
    far = far_light(dataset.train, images, units, ROWS)
    return float(looked_through(points, dataset.train, images, far, units).sum() / max(swept, 1))


def tried(
    dataset: Dataset, settings: Settings, reason: str, progress: Progress, device: torch.device = CPU
) -> Rung:
    """A short training without an environment and one with, judged on views that neither saw.

    Args:
        dataset: Views to train on; one view in four is held out of the trial.
        settings: Of the training that is decided on.
        reason: What is known without the trial; the reason of the rung begins with it.
        progress: Callback for the current step, the steps done, and all of them.
        device: Device that trains.

    Returns:
        Rung of the environment: taken if the gain in dB exceeds `ERRORS` standard errors.
    """
    if settings.max_width > TRIAL_WIDTH:
        small = again(dataset, TRIAL_WIDTH, progress)
        dataset = replace(settings.overrides.subset(small), watched=dataset.watched)
    most = min(TRIAL_GAUSSIANS, room(dataset))
    trials = Trials.from_new_points(dataset, settings, most // 2, progress, device)
    iterations = min(MOST_ITERATIONS, TRIAL_LOOKS * len(trials.part.train))
    extent = trials.part.extent
    trials.steps.total = 2 * iterations
    plain, far = (
        trials.trained(iterations, most, f"a trial {how} a far field", environment=there)
        for how, there in (("without", False), ("with", True))
    )
    gains = [
        robust_score_db(far, view, (), extent) - robust_score_db(plain, view, (), extent)
        for view in trials.judged
    ]
    return Rung.judged(
        NAME,
        float(np.mean(gains)),
        float(np.std(gains, ddof=1) / np.sqrt(len(gains))),
        UNIT,
        f"{reason}; two trainings of {iterations} iterations, judged on {len(gains)} views held out of both",
        errors=ERRORS,
    )

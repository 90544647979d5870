"""The decisions of a training, in order, from what was asked for to what is trained.

Each is a function of one shape: it looks at the case and at what was decided before it, and returns that with
its own choice, and the rung it leaves, added. `ORDER` is the page to read.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
import torch

from imaging.arrays import Array
from imaging.progress import Progress
from imaging.session.records import Rung
from recon.data.dataset import Dataset
from recon.data.light import Images, Light, light_of, radiance_images
from recon.data.measured_depth import DepthFit
from recon.decide.corrections import refinement_for
from recon.decide.countdown import MOST_OF_START, Countdown
from recon.decide.far_field import environment_for
from recon.decide.measured_depth import depth_fit, depth_for
from recon.decide.prediction import Prediction, enough, predicted
from recon.decide.probe import FEWEST, GROWTH, Probe, has_time_for_trials, pace_at_once, probe
from recon.decide.settings import Settings
from recon.decide.size import degree_for, fewer, gaussians_for, most_for
from recon.decide.trials import reason_against_trials
from recon.observe.refinement import Refinement
from recon.scene.environment import Environment
from recon.start.far_light import far_light, without_far
from recon.start.initialisation import Start, gaussians_at, points_of_poses, scattered, start_points
from recon.train.ranks import Ranks
from recon.train.training import Training

NO_TIME = "not tried, since a trial would take its time from the budget"


@dataclass(frozen=True)
class Run:
    """Running reconstruction: its subject and its environment.

    asked: the requested settings, the method among them. countdown: of a budget of time. say: callback for
    messages on skipped steps and predictions. smaller: the smaller training if the time is too short for this
    one, or None.
    """

    dataset: Dataset
    asked: Settings
    device: torch.device
    ranks: Ranks
    countdown: Countdown | None
    progress: Progress
    say: Callable[[str], None]
    clock: Callable[[], float]
    smaller: Settings | None = field(default=None, kw_only=True)


@dataclass(frozen=True)
class Case(Run):
    """Inputs of every decision: the run, and the views.

    dataset: with its depth maps, if they fit, in scene coordinates. images: the radiance images of the
    training views; look: seconds that they took. depths: the fit of the maps, or None without maps.
    """

    images: Images
    light: Light
    look: float
    depths: DepthFit | None = None

    @classmethod
    def of(cls, run: Run) -> "Case":
        """Read the training views for the first time."""
        began = run.clock()
        images = radiance_images(run.dataset, run.progress)
        light, depths = light_of(run.dataset, images), depth_fit(run.dataset, images, run.progress)
        used = depths is not None and depths.fits and run.asked.overrides.depth != 0
        dataset = run.dataset.with_depths(depths.scale if depths is not None and used else None)
        look = run.ranks.broadcast(run.clock() - began)
        parts = vars(run) | {"dataset": dataset}
        return cls(**parts, images=images, light=light, look=look, depths=depths)

    def seconds_left(self) -> float | None:
        """Seconds until training has to be over, the same on all ranks; None without a time limit."""
        return None if self.countdown is None else self.ranks.broadcast(self.countdown.left())


@dataclass(frozen=True)
class Decisions:
    """Decisions so far.

    settings: the requested ones, with decisions in place of defaults. first: points of a sweep over all
    depths, where poses came without any. points: to start from. far: the environment behind them at the
    start. against_trials: the reason against trials, or None if they are allowed. rungs: the evidence for the
    size, the environment and depth; that for the corrections is in `refinement`.
    """

    settings: Settings
    refinement: Refinement
    rungs: tuple[Rung, ...] = ()
    prediction: Prediction | None = None
    first: Array | None = None
    points: Start | None = None
    far: Environment | None = None
    against_trials: str | None = None

    def setting(self, **changed: int) -> "Decisions":
        """The same with other settings."""
        return replace(self, settings=self.settings.model_copy(update=changed))

    def of_trials(self, case: Case) -> Settings:
        """Return what was asked for, with what trials train with as it was decided."""
        decided = {name: getattr(self.settings, name) for name in ("environment", "depth")}
        return case.asked.model_copy(update=decided)

    def training(self, case: Case) -> Training:
        """A training as decided by now, not yet begun."""
        assert self.points is not None
        dataset = case.dataset
        method = self.settings.composed(dataset, case.light)
        gaussians = gaussians_at(self.points, method.appearance, method.observation.units)
        decided = self.refinement
        refinement = Refinement.of(
            dataset, decided.parameters, decided.rungs, decided.parameters.get("glare")
        )
        far = None if self.far is None else self.far.copied()
        return Training.begin(method, case.light, gaussians, dataset.extent, case.device, refinement, far)


def decide(case: Case) -> Decisions:
    """Everything that is decided before a training begins; trials are made on the way."""
    decided = Decisions(case.asked, Refinement.of(case.dataset, ()))
    for decision in ORDER:
        decided = decision(case, decided)
    return decided


def longest(case: Case, decided: Decisions) -> Decisions:
    """Cap the iterations where earlier scenes stopped improving."""
    return decided.setting(iterations=iterations_at_most(case.asked))


def report(case: Case, decided: Decisions) -> Decisions:
    """Decide whether the budget of time has room for the report, by the time that the views took.

    TooShort where it has no room for a training.
    """
    if case.countdown is not None:
        case.countdown.plan(case.look, len(case.dataset.train), len(case.dataset.held_out))
        case.countdown.require(case.look, FEWEST, case.seconds_left())
    return decided


def degree(case: Case, decided: Decisions) -> Decisions:
    """Choose the degree of the harmonics by scene points seen from all sides, and leave its rung."""
    first = (
        None if len(case.dataset.points().xyz) else points_of_poses(case.dataset, case.images, case.progress)
    )
    chosen, rung = degree_for(case.dataset, case.asked, case.images, case.ranks, first)
    return replace(decided.setting(degree=chosen), rungs=(rung,), first=first)


def most_gaussians(case: Case, decided: Decisions) -> Decisions:
    """Choose the maximum number of Gaussians by preset, budget and samples of the views."""
    return decided.setting(max_gaussians=most_for(case.dataset, case.asked, decided.settings.degree or 0))


def room(case: Case, decided: Decisions) -> Decisions:
    """Raise TooShort where the time has no room for the fewest iterations, by the speed of a few; after a
    start only, if a smaller size exists that would begin with one.
    """
    seconds = case.seconds_left()
    if case.countdown is not None and seconds is not None:
        asked = case.asked
        points = scattered(case.dataset, int(asked.start_share * decided.settings.max_gaussians), asked.seed)
        begin = partial(replace(decided, points=points).training, case)
        pace = pace_at_once(begin, case.dataset, decided.settings.plan(), case.ranks, case.clock)
        started = 1.0 if case.smaller is None else 1 - MOST_OF_START
        least = Probe(0, pace * GROWTH, None).seconds_for(min(FEWEST, decided.settings.iterations))
        case.countdown.require(least / started, FEWEST, case.seconds_left())
    return decided


def start(case: Case, decided: Decisions) -> Decisions:
    """Choose the number of views that are swept for depth, by the time, and the points of the start."""
    asked, countdown = case.asked, case.countdown
    count = int(asked.start_share * decided.settings.max_gaussians)
    rng = np.random.Generator(np.random.PCG64([asked.seed, 0x57A27]))
    # Several processes have to begin with the same points, whichever is slower.
    over = countdown.start_over() if countdown is not None and case.ranks.count == 1 else None
    points = start_points(case.dataset, case.images, count, rng, case.progress, over, decided.first)
    if countdown is not None and points.left_out:
        few = f"{points.left_out} of {len(case.dataset.train)} views"
        case.say(f"{countdown.seconds:g} s leave no room for the depths of {few}.")
    return replace(decided, points=points)


def trials(case: Case, decided: Decisions) -> Decisions:
    """Decide whether trials may be made, by preset, overrides, views and speed."""
    reason, seconds = reason_against_trials(case.dataset, case.asked), case.seconds_left()
    if reason is None and case.countdown is not None and seconds is not None:
        begin, plan = partial(decided.training, case), decided.settings.plan()
        if not has_time_for_trials(begin, case.dataset, plan, seconds, ranks=case.ranks, clock=case.clock):
            case.say(f"{case.countdown.seconds:g} s leave no room for trials of what the scene needs.")
            reason = NO_TIME
    return replace(decided, against_trials=reason)


def environment(case: Case, decided: Decisions) -> Decisions:
    """Decide whether an environment lies behind the Gaussians, by views that look through the points of the
    start, where that is not sure by a trial, and leave its rung.
    """
    points = decided.points
    assert points is not None
    dataset = case.dataset
    units = decided.settings.composed(dataset, case.light).observation.units
    taken, rung = environment_for(
        dataset, decided.settings, case.images, points, units, decided.against_trials, case.ranks,
        case.progress,
    )  # fmt: skip
    decided = replace(decided, rungs=(*decided.rungs, rung))
    if not taken:
        return decided
    far = far_light(dataset.train, case.images, units)
    points = without_far(points, dataset.train, case.images, far, units)
    settings = decided.settings.model_copy(update={"environment": True})
    return replace(decided, settings=settings, far=far, points=points)


def depth(case: Case, decided: Decisions) -> Decisions:
    """Choose the weight of measured depth, by its fit to the scene points, then by trials, and leave its
    rungs.
    """
    weight, rungs = depth_for(
        case.dataset, case.depths, decided.settings, decided.against_trials, case.ranks, case.progress
    )
    update = {"depth": weight, "depth_scale": case.dataset.depth_scale}
    settings = decided.settings.model_copy(update=update)
    return replace(decided, settings=settings, rungs=(*decided.rungs, *rungs))


def corrections(case: Case, decided: Decisions) -> Decisions:
    """Choose the corrections of the calibration, by its errors, else by trials."""
    asked = decided.of_trials(case)
    refinement = refinement_for(
        case.dataset, case.images, asked, decided.against_trials, case.ranks, case.progress
    )
    return replace(decided, refinement=refinement)


def gaussians(case: Case, decided: Decisions) -> Decisions:
    """Choose the number of Gaussians, by trials or by the samples of the views."""
    asked = decided.of_trials(case)
    points, colours = decided.points, decided.settings.degree or 0
    assert points is not None
    count, rung = gaussians_for(
        case.dataset, asked, decided.against_trials, colours, decided.refinement, points,
        case.ranks, case.progress, case.device,
    )  # fmt: skip
    colour, *others = decided.rungs
    colour = colour.model_copy(update={"parameters": (colour.parameters or 0) * count})
    points = fewer(points, int(asked.start_share * count), asked.seed)
    return replace(decided.setting(max_gaussians=count), points=points, rungs=(rung, colour, *others))


def iterations(case: Case, decided: Decisions) -> Decisions:
    """Choose the iterations that fit into a budget, by a training in miniature.

    Leaves a prediction of the quality. TooShort where too few iterations fit.
    """
    if case.asked.budget is None:
        return decided
    most, countdown, begin = decided.settings.iterations, case.countdown, partial(decided.training, case)
    miniature = probe(
        begin, case.dataset, decided.settings.plan(), case.seconds_left(),
        ranks=case.ranks, progress=case.progress, clock=case.clock,
    )  # fmt: skip
    if countdown is not None:
        available = case.ranks.broadcast(countdown.left())
        fitting = miniature.iterations_within(available)
        if fitting < min(FEWEST, most):
            countdown.require(max(miniature.seconds_for(FEWEST), available + 1.0), FEWEST, available)
        decided = decided.setting(iterations=min(most, fitting))
    if miniature.db is None:
        return decided
    length = decided.settings.iterations * decided.settings.batch
    guess = predicted(miniature.db, miniature.iterations, length, timed=countdown is not None)
    if case.ranks.first:
        width = max(view.lens.width for view in case.dataset.views)
        case.say(f"predicted: held-out {guess.db:.1f} dB ({guess.low:.1f} to {guess.high:.1f}) at {width} px")
    return replace(decided, prediction=guess)


ORDER: tuple[Callable[[Case, Decisions], Decisions], ...] = (
    longest,
    report,
    degree,
    most_gaussians,
    room,
    start,
    trials,
    environment,
    depth,
    corrections,
    gaussians,
    iterations,
)


def iterations_at_most(asked: Settings) -> int:
    """Number of iterations requested; with early stop, capped where other scenes stopped improving."""
    if not asked.early_stop:
        return asked.iterations
    return math.ceil(enough(asked.iterations * asked.batch) / asked.batch)

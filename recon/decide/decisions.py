"""The decisions of a training, in order, from what was asked for to what is trained.

Each is a function of one shape: it looks at the case and at what was decided before it, and returns that with
its own choice, and the rung it leaves, added. `ORDER` is the page to read.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
import numpy.typing as npt
import torch

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
    """A reconstruction under way: what it is of, and what it runs on.

    asked: the settings asked for, the method among them. countdown: of a budget of time. say: is given lines
    on what has no room, and on what is predicted. smaller: what is trained where the time has no room for
    this; None: nothing.
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
    """What every decision may look at: the run, and the views.

    dataset: with its depth maps, if there are any that fit, in scene coordinates. images: the radiance images
    of the training views; look: seconds that they took. depths: how the maps fit; None: there are none.
    """

    images: Images
    light: Light
    look: float
    depths: DepthFit | None = None

    @classmethod
    def of(cls, run: Run) -> "Case":
        """Look at the training views for the first time."""
        began = run.clock()
        images = radiance_images(run.dataset, run.progress)
        light, depths = light_of(run.dataset, images), depth_fit(run.dataset, images, run.progress)
        used = depths is not None and depths.fits and run.asked.overrides.depth != 0
        dataset = run.dataset.with_depths(depths.scale if depths is not None and used else None)
        look = run.ranks.broadcast(run.clock() - began)
        parts = vars(run) | {"dataset": dataset}
        return cls(**parts, images=images, light=light, look=look, depths=depths)

    def seconds_left(self) -> float | None:
        """Until training has to be over, the same on all ranks; None where time is no matter."""
        return None if self.countdown is None else self.ranks.broadcast(self.countdown.left())


@dataclass(frozen=True)
class Decisions:
    """What is decided so far.

    settings: those asked for, with what was decided in place of it. first: points of a sweep over all depths,
    where poses came without any. points: to start from. far: what is
    behind them at the start. against_trials: why none is made; None: they are. rungs: the evidence for the
    size, the environment and depth; that for the corrections is in `refinement`.
    """

    settings: Settings
    refinement: Refinement
    rungs: tuple[Rung, ...] = ()
    prediction: Prediction | None = None
    first: npt.NDArray[np.float64] | None = None
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
    """Looks at how much other scenes gained by how many iterations; chooses how many there are at most."""
    return decided.setting(iterations=iterations_at_most(case.asked))


def report(case: Case, decided: Decisions) -> Decisions:
    """Looks at how long the views took; chooses whether the budget of time has room for the report.

    TooShort where it has no room for a training.
    """
    if case.countdown is not None:
        case.countdown.plan(case.look, len(case.dataset.train), len(case.dataset.held_out))
        case.countdown.require(case.look, FEWEST, case.seconds_left())
    return decided


def degree(case: Case, decided: Decisions) -> Decisions:
    """Looks at scene points from all sides; chooses the degree of the harmonics, and leaves its rung."""
    first = (
        None if len(case.dataset.points().xyz) else points_of_poses(case.dataset, case.images, case.progress)
    )
    chosen, rung = degree_for(case.dataset, case.asked, case.images, case.ranks, first)
    return replace(decided.setting(degree=chosen), rungs=(rung,), first=first)


def most_gaussians(case: Case, decided: Decisions) -> Decisions:
    """Looks at preset, budget and samples of the views; chooses how many Gaussians there are at most."""
    return decided.setting(max_gaussians=most_for(case.dataset, case.asked, decided.settings.degree or 0))


def room(case: Case, decided: Decisions) -> Decisions:
    """Looks at the speed of a few iterations; TooShort where the time has no room for the fewest, be it only
    after a start, where a smaller size is there that would begin with one.
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
    """Looks at the time there is; chooses how many views are swept for depth, and the points of the start."""
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
    """Looks at preset, overrides, views and speed; chooses whether trials may decide what follows."""
    reason, seconds = reason_against_trials(case.dataset, case.asked), case.seconds_left()
    if reason is None and case.countdown is not None and seconds is not None:
        begin, plan = partial(decided.training, case), decided.settings.plan()
        if not has_time_for_trials(begin, case.dataset, plan, seconds, ranks=case.ranks, clock=case.clock):
            case.say(f"{case.countdown.seconds:g} s leave no room for trials of what the scene needs.")
            reason = NO_TIME
    return replace(decided, against_trials=reason)


def environment(case: Case, decided: Decisions) -> Decisions:
    """Looks at what views see in the same directions, then at a trial; chooses whether light from far away is
    behind the Gaussians, and leaves its rung.
    """
    points = decided.points
    assert points is not None
    dataset = case.dataset
    taken, rung = environment_for(
        dataset, decided.settings, case.images, decided.against_trials, case.ranks, case.progress
    )
    decided = replace(decided, rungs=(*decided.rungs, rung))
    if not taken:
        return decided
    units = decided.settings.composed(dataset, case.light).observation.units
    far = far_light(dataset.train, case.images, units)
    settings = decided.settings.model_copy(update={"environment": True})
    return replace(decided, settings=settings, far=far, points=without_far(points, dataset.train))


def depth(case: Case, decided: Decisions) -> Decisions:
    """Looks at how depth maps fit the scene points, then at trials; chooses how much training compares with
    them, and leaves its rungs.
    """
    weight, rungs = depth_for(
        case.dataset, case.depths, decided.settings, decided.against_trials, case.ranks, case.progress
    )
    update = {"depth": weight, "depth_scale": case.dataset.depth_scale}
    settings = decided.settings.model_copy(update=update)
    return replace(decided, settings=settings, rungs=(*decided.rungs, *rungs))


def corrections(case: Case, decided: Decisions) -> Decisions:
    """Looks at the errors of the calibration, else at trials; chooses what training corrects in it."""
    asked = decided.of_trials(case)
    refinement = refinement_for(
        case.dataset, case.images, asked, decided.against_trials, case.ranks, case.progress
    )
    return replace(decided, refinement=refinement)


def gaussians(case: Case, decided: Decisions) -> Decisions:
    """Looks at trials, or at the samples of the views; chooses how many Gaussians the scene is given."""
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
    """Looks at a training in miniature, where there is a budget; chooses how many iterations fit into it.

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
    """As many as were asked for; with early stop as many of them as were worth it in other scenes."""
    if not asked.early_stop:
        return asked.iterations
    return math.ceil(enough(asked.iterations * asked.batch) / asked.batch)

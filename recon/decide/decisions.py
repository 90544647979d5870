"""The decisions of a training, from the settings that were asked for to the plan that is trained.

`decide` is the page to read. Each decision looks at the evidence and at the decisions before it.
"""

import math
from dataclasses import replace
from functools import partial

import numpy as np

from imaging.arrays import Array
from imaging.session.records import Rung
from recon.data.stated_factors import asked_parts, overruled
from recon.decide.cost.countdown import MOST_OF_START
from recon.decide.cost.duration import far_trial
from recon.decide.cost.prediction import enough, predicted
from recon.decide.cost.probe import FEWEST, GROWTH, Probe, has_time_for_trials, pace_at_once, probe
from recon.decide.evidence import Evidence, Run
from recon.decide.plan import TrainingPlan
from recon.decide.settings import Settings
from recon.decide.steps.corrections import corrections_for
from recon.decide.steps.depth_weight import depth_for
from recon.decide.steps.far_field import environment_for
from recon.decide.steps.size import degree_for, fewer, gaussians_for, most_for
from recon.decide.steps.stated_settings import in_words, overruled_parts
from recon.decide.trials import reason_against_trials
from recon.scene.environment import Environment
from recon.start.far_light import far_light, without_far
from recon.start.initialisation import FEWEST_POINTS, Start, points_of_poses, scattered, start_points

MOST_OF_FAR_TRIAL = 0.2
"""Share of the time left that the trial of a far field may take."""
NO_TIME = "not tried, since a trial would take its time from the budget"


def planned(run: Run) -> TrainingPlan:
    """Decide which light of the photographs holds, then everything else by it; TooShort as `decide`."""
    run, evidence, rungs = with_light_of_photographs(run, Evidence.of(run))
    plan = decide(run, evidence)
    return replace(plan, rungs=(*rungs, *plan.rungs))


def with_light_of_photographs(run: Run, evidence: Evidence) -> tuple[Run, Evidence, tuple[Rung, ...]]:
    """Replace exposures and white balances stated in the files by those estimated from scene points, if this
    improves held-out renders or was asked for.

    Returns:
        The run and its evidence with what was replaced, and the reasons, a rung for each part considered.
    """
    asked, dataset = run.asked, evidence.dataset
    if not asked_parts(dataset) and asked.overrides.overrule is None:
        return run, evidence, ()
    points = scattered(dataset, int(asked.start_share * asked.max_gaussians), asked.seed)
    plan = TrainingPlan(asked, evidence.light, points=points)
    # Trials of what the scene needs are decided on, and spoken of, by what is known then.
    against_trials = _reason_against_trials(replace(run, say=lambda line: None), evidence, plan)
    parts, rungs = overruled_parts(run, evidence, against_trials)
    if not parts:
        return run, evidence, rungs
    for part, rung in zip(parts, (rung for rung in rungs if rung.taken), strict=True):
        run.say(in_words(dataset, part, rung))
    decided = asked.model_copy(update={"overruled": parts})
    run = replace(run, dataset=overruled(run.dataset, parts), asked=decided)
    return run, Evidence.of(run), rungs


def decide(run: Run, evidence: Evidence) -> TrainingPlan:
    """Everything that is decided before a training begins; trials are made on the way.

    Raises:
        TooShort: A budget of time has no room for the fewest iterations.
    """
    asked, countdown = run.asked, run.countdown
    dataset = evidence.dataset

    # Iterations at most: with early stop as many as were worth it in other scenes.
    decided = _with(asked, iterations=iterations_at_most(asked))

    # The report, and any training at all: whether a time has room for them, by what the first look took.
    if countdown is not None:
        countdown.plan(evidence.look, len(dataset.train), len(dataset.held_out))
        countdown.require(evidence.look, FEWEST)

    # The degree of the harmonics, by scene points seen from all sides.
    first = None
    if not len(dataset.points().xyz):
        first = points_of_poses(dataset, evidence.images, run.progress, evidence.light)
    degree, colour = degree_for(run, evidence, first)

    # The most Gaussians, by preset, budget and samples of the views.
    decided = _with(decided, degree=degree, max_gaussians=most_for(dataset, asked, degree))
    pace = _require_room(run, evidence, decided)

    # The starting points, and whether short trainings from them may decide what follows.
    points = _start(run, evidence, decided, first)
    plan = TrainingPlan(decided, evidence.light, points=points)
    against_trials = _reason_against_trials(run, evidence, plan)

    # Light from far away behind the Gaussians: by views that look through the points, and a trial.
    environment, points, far = _far_field(run, evidence, decided, points, pace)
    if far is not None:
        decided = _with(decided, environment=True)

    # Measured depth: its weight, by its fit to the scene points, then by trials.
    weight, depth = depth_for(run, evidence, decided, against_trials)
    decided = _with(decided, depth=weight, depth_scale=dataset.depth_scale)

    # Corrections of the calibration, by its errors, else by trials of what was asked for with these two.
    of_trials = _with(asked, environment=decided.environment, depth=weight)
    corrections = corrections_for(run, evidence, of_trials, against_trials)

    # The number of Gaussians, by trials that halve it or by the samples of the views.
    count, size = gaussians_for(run, evidence, of_trials, against_trials, degree, corrections.names, points)
    colour = colour.model_copy(update={"parameters": (colour.parameters or 0) * count})
    points = fewer(points, _begun_with(asked, count), asked.seed)
    decided = _with(decided, max_gaussians=count)

    rungs = (size, colour, environment, *depth)
    plan = TrainingPlan(decided, evidence.light, corrections, rungs, points=points, far=far)
    return plan if asked.budget is None else _within_budget(run, evidence, plan)


def iterations_at_most(asked: Settings) -> int:
    """Number of iterations requested; with early stop, capped where other scenes stopped improving."""
    if not asked.early_stop:
        return asked.iterations
    return math.ceil(enough(asked.iterations * asked.batch) / asked.batch)


def _with(settings: Settings, **decided: float | None) -> Settings:
    return settings.model_copy(update=decided)


def _require_room(run: Run, evidence: Evidence, settings: Settings) -> float:
    """Raise TooShort if the time has no room for the fewest iterations.

    Measures the speed over a few iterations. If a smaller size is available, time for initialisation is
    reserved as well.

    Returns:
        Seconds of an iteration; 0 without a budget of time.
    """
    if run.countdown is None:
        return 0.0
    dataset = evidence.dataset
    points = scattered(dataset, int(settings.start_share * settings.max_gaussians), settings.seed)
    plan = TrainingPlan(settings, evidence.light, points=points)
    begin = partial(plan.training, dataset, run.device)
    pace = pace_at_once(begin, dataset, settings.plan(), run.clock)
    started = 1.0 if run.smaller is None else 1 - MOST_OF_START
    least = Probe(0, pace * GROWTH, None).seconds_for(min(FEWEST, settings.iterations))
    run.countdown.require(least / started, FEWEST)
    return pace


def _start(run: Run, evidence: Evidence, settings: Settings, first: Array | None) -> Start:
    """Points to start from, with the depths of as many views as the time has room for.

    first: points of a sweep over all depths, where poses came without any.
    """
    countdown, dataset = run.countdown, evidence.dataset
    count = _begun_with(settings, settings.max_gaussians)
    rng = np.random.Generator(np.random.PCG64([settings.seed, 0x57A27]))
    over = None if countdown is None else countdown.start_over()
    points = start_points(dataset, evidence.images, count, rng, run.progress, over, first, evidence.light)
    if countdown is not None and points.left_out:
        few = f"{points.left_out} of {len(dataset.train)} views"
        run.say(f"{countdown.seconds:g} s leave no room for the depths of {few}.")
    return points


def _far_field(
    run: Run, evidence: Evidence, settings: Settings, points: Start, pace: float
) -> tuple[Rung, Start, Environment | None]:
    """Decide on an environment: its rung, the starting points that stay before it, and its light if it is
    taken.

    pace: seconds of an iteration, where there is a budget of time.
    """
    dataset, images = evidence.dataset, evidence.images
    units = settings.composed(dataset, evidence.light).observation.units
    # The trial is short enough for a draft, and does not depend on what was set by hand.
    trial = pace * far_trial(dataset.train, int(settings.start_share * settings.max_gaussians))
    seconds = run.seconds_left()
    against = NO_TIME if seconds is not None and trial > MOST_OF_FAR_TRIAL * seconds else None
    rung = environment_for(run, evidence, settings, points, units, against)
    if not rung.taken:
        return rung, points, None
    far = far_light(dataset.train, images, units)
    return rung, without_far(points, dataset.train, images, far, units), far


def _begun_with(settings: Settings, most: int) -> int:
    """Points that a training of at most `most` Gaussians begins with: its share, or the fewest allowed."""
    return max(FEWEST_POINTS, int(settings.start_share * most))


def _reason_against_trials(run: Run, evidence: Evidence, plan: TrainingPlan) -> str | None:
    """Return why trials may not be made, by preset, overrides, views and speed; None if they may."""
    reason, seconds = reason_against_trials(evidence.dataset, run.asked), run.seconds_left()
    if reason is not None or run.countdown is None or seconds is None:
        return reason
    begin = partial(plan.training, evidence.dataset, run.device)
    if has_time_for_trials(begin, evidence.dataset, plan.settings.plan(), seconds, clock=run.clock):
        return None
    run.say(f"{run.countdown.seconds:g} s leave no room for trials of what the scene needs.")
    return NO_TIME


def _within_budget(run: Run, evidence: Evidence, plan: TrainingPlan) -> TrainingPlan:
    """The plan with the iterations that fit into a budget, by a training in miniature, and a prediction.

    TooShort where too few iterations fit.
    """
    countdown, most = run.countdown, plan.settings.iterations
    miniature = probe(
        partial(plan.training, evidence.dataset, run.device), evidence.dataset, plan.settings.plan(),
        run.seconds_left(), progress=run.progress, clock=run.clock,
    )  # fmt: skip
    settings = plan.settings
    if countdown is not None:
        available = countdown.remaining()
        fitting = miniature.iterations_within(available)
        if fitting < min(FEWEST, most):
            countdown.require(max(miniature.seconds_for(FEWEST), available + 1.0), FEWEST)
        settings = _with(settings, iterations=min(most, fitting))
    plan = replace(plan, settings=settings)
    if miniature.db is None:
        return plan
    length = settings.iterations * settings.batch
    guess = predicted(miniature.db, miniature.iterations, length, timed=countdown is not None)
    width = max(view.lens.width for view in evidence.dataset.views)
    run.say(f"predicted: held-out {guess.db:.1f} dB ({guess.low:.1f} to {guess.high:.1f}) at {width} px")
    return replace(plan, prediction=guess)

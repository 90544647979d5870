"""What each decision of a training leaves for the next, and what a small session is decided by."""

import json
import time

import numpy as np
import pytest

from imaging.session.records import Rung
from recon.decide import decisions
from recon.decide.cost.countdown import Countdown
from recon.decide.cost.prediction import enough
from recon.decide.decisions import NO_TIME, decide
from recon.decide.evidence import Evidence
from recon.decide.overrides import Overrides
from recon.decide.plan import TrainingPlan
from recon.start.initialisation import Start

from .runs import run_of, settings


def test_a_few_small_pictures_are_decided_without_a_trial(toy_dataset):
    wanted = settings()
    run = run_of(toy_dataset, wanted)
    decided = decide(run, Evidence.of(run))
    assert (decided.settings.degree, decided.settings.max_gaussians) == (0, 400)
    assert [rung.name for rung in decided.rungs] == [
        "number of Gaussians",
        "direction-dependent colour",
        "environment",
    ]
    assert [rung.taken for rung in decided.corrections.rungs] == [False] * 4
    assert len(decided.points.xyz) <= 200
    assert decided.prediction is None
    assert decided.settings.iterations == wanted.iterations

    stored = json.loads(json.dumps(decided.facts()))
    again = TrainingPlan.stored(stored, decided.light)
    assert (again.settings, again.rungs, again.prediction) == (decided.settings, decided.rungs, None)


@pytest.mark.parametrize("most", [16, 100])
def test_a_scene_of_few_gaussians_that_are_grown_has_enough_to_start_from(toy_dataset, most):
    few = Overrides(gaussians=most, growth=0.95, environment=False)
    run = run_of(toy_dataset, settings(max_gaussians=most, overrides=few))
    plan = decide(run, Evidence.of(run))
    assert len(plan.points.xyz) == 8
    assert plan.settings.max_gaussians == most


def test_early_stop_asks_for_no_more_than_was_worth_it():
    asked = settings(iterations=2000, early_stop=True, batch=2)
    assert decisions.iterations_at_most(asked) == -(-enough(4000) // 2)


@pytest.mark.parametrize("fits", [True, False])
def test_a_budget_of_time_decides_whether_trials_may(toy_long, monkeypatch, fits):
    monkeypatch.setattr(decisions, "has_time_for_trials", lambda *_, **__: fits)
    said = []
    run = run_of(toy_long, settings(budget=60.0), Countdown(60.0, time.monotonic()), said)
    evidence = Evidence.of(run)
    plan = TrainingPlan(run.asked, evidence.light)
    reason = decisions._reason_against_trials(run, evidence, plan)
    assert reason == (None if fits else NO_TIME)
    assert bool(said) != fits


@pytest.mark.parametrize(("pace", "against"), [(0.001, None), (1.0, NO_TIME)])
def test_far_light_is_tried_within_a_budget_whatever_was_set_by_hand(toy_long, monkeypatch, pace, against):
    reasons = []

    def without(run, evidence, settings, points, units, reason):
        reasons.append(reason)
        return Rung(name="environment", taken=False, reason="")

    monkeypatch.setattr(decisions, "environment_for", without)
    by_hand = settings(budget=60.0, overrides=Overrides(width=32, gaussians=400), quality="draft")
    run = run_of(toy_long, by_hand, Countdown(60.0, time.monotonic()))
    decisions._far_field(run, Evidence.of(run), by_hand, Start(np.zeros((0, 3)), np.zeros((0, 3)), 0), pace)
    assert reasons == [against]


def test_a_training_of_the_decisions_begins_anew_each_time(toy_dataset):
    run = run_of(toy_dataset, settings())
    plan = decide(run, Evidence.of(run))
    first, second = (plan.training(toy_dataset, run.device) for _ in range(2))
    assert first is not second
    for name, values in first.gaussians.parameters.items():
        assert np.array_equal(values.detach(), second.gaussians.parameters[name].detach())

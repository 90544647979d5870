"""The order of the decisions is the one that the package tells, and each leaves what the next looks at."""

import re
import time

import numpy as np
import pytest
import torch

import recon.decide as package
from imaging.progress import unreported
from recon.decide import decisions
from recon.decide.countdown import Countdown
from recon.decide.decisions import NO_TIME, ORDER, Case, Decisions, Run, decide
from recon.decide.prediction import enough
from recon.observe.refinement import Refinement
from recon.train.ranks import Ranks

from .test_corrections import settings


def run_of(dataset, wanted, countdown=None, said=None) -> Run:
    say = (said if said is not None else []).append
    cpu = torch.device("cpu")
    return Run(dataset, wanted, cpu, Ranks(), countdown, unreported, say, time.monotonic)


def test_the_package_tells_the_order_of_the_decisions():
    told = re.findall(r"^(\d+)\. (.+?)[:,]", package.__doc__, re.M)
    assert [int(number) for number, _ in told] == list(range(1, len(ORDER) + 2))
    assert [name for _, name in told[1:]] == [
        "iterations at most", "report", "degree of the harmonics", "most Gaussians", "room",
        "starting points", "trials", "environment", "measured depth", "corrections of the calibration",
        "number of Gaussians", "iterations",
    ]  # fmt: skip
    assert [decision.__name__ for decision in ORDER] == [
        "longest", "report", "degree", "most_gaussians", "room", "start", "trials", "environment", "depth",
        "corrections", "gaussians", "iterations",
    ]  # fmt: skip


def test_a_few_small_pictures_are_decided_without_a_trial(toy_dataset):
    wanted = settings()
    decided = decide(Case.of(run_of(toy_dataset, wanted)))
    assert decided.against_trials is not None
    assert (decided.settings.degree, decided.settings.max_gaussians) == (0, 400)
    assert [rung.name for rung in decided.rungs] == [
        "number of Gaussians",
        "direction-dependent colour",
        "environment",
    ]
    assert [rung.taken for rung in decided.refinement.rungs] == [False] * 4
    assert len(decided.points.xyz) <= 200
    assert decided.prediction is None
    assert decided.settings.iterations == wanted.iterations


def test_early_stop_asks_for_no_more_than_was_worth_it(toy_dataset):
    case = Case.of(run_of(toy_dataset, settings(iterations=2000, early_stop=True, batch=2)))
    decided = decisions.longest(case, Decisions(case.asked, Refinement.of(toy_dataset, ())))
    assert decided.settings.iterations == -(-enough(4000) // 2)


@pytest.mark.parametrize("fits", [True, False])
def test_a_budget_of_time_decides_whether_trials_may(toy_long, monkeypatch, fits):
    monkeypatch.setattr(decisions, "has_time_for_trials", lambda *_, **__: fits)
    said = []
    case = Case.of(run_of(toy_long, settings(budget=60.0), Countdown(60.0, time.monotonic()), said))
    decided = decisions.trials(case, Decisions(case.asked, Refinement.of(toy_long, ())))
    assert decided.against_trials == (None if fits else NO_TIME)
    assert bool(said) != fits


def test_a_training_of_the_decisions_begins_anew_each_time(toy_dataset):
    case = Case.of(run_of(toy_dataset, settings()))
    decided = decide(case)
    first, second = decided.training(case), decided.training(case)
    assert first is not second
    for name, values in first.gaussians.parameters.items():
        assert np.array_equal(values.detach(), second.gaussians.parameters[name].detach())

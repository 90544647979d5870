"""Trials within a time: made where it has room for them, and left out where it has not."""

import itertools
import shutil

import pytest

from imaging.files import store
from recon.decide.cost.budget import Budget
from recon.decide.cost.probe import has_time_for_trials
from recon.decide.presets import QUALITIES, Quality
from recon.decide.request import TrainingRequest
from recon.reconstruct import reconstruct
from recon.result.model import read_model
from recon.train.densification import DensityRules
from recon.train.training import Plan
from tests.recon.beginning import beginning

from ..runs import settings
from ..steps.test_corrections import rungs_of

SHORT, LONG = Plan(20, DensityRules(400), 0), Plan(2000, DensityRules(400), 0)


@pytest.fixture
def begin(toy_dataset):
    """Function that begins a training of the toy, each time the same."""
    return beginning(toy_dataset, 200)


@pytest.fixture
def sixteen(toy_long, tmp_path, monkeypatch):
    """A session of sixteen views, for a preset that is short."""
    monkeypatch.setitem(QUALITIES, "standard", Quality(30, 400, 64))
    monkeypatch.setattr("recon.decide.steps.corrections.TRIAL_LOOKS", 2)
    monkeypatch.setattr("recon.decide.steps.corrections.TRIAL_GAUSSIANS", 400)
    monkeypatch.setattr("recon.decide.held_out_evidence.STEPS", 4)
    return shutil.copytree(toy_long.session, tmp_path / "session")


def test_there_is_time_for_trials_where_the_whole_schedule_fits_after_them(toy_dataset, begin):
    def fits(plan: Plan, seconds: float) -> bool:
        clock = itertools.count(step=0.01)
        return has_time_for_trials(begin, toy_dataset, plan, seconds, clock=lambda: next(clock))

    assert [fits(SHORT, seconds) for seconds in (1e-3, 1e6)] == [False, True]
    # A hundred times the iterations take a hundred times as long.
    enough = next(seconds for seconds in (2.0**n for n in range(-10, 20)) if fits(SHORT, seconds))
    assert not fits(LONG, 49 * enough)
    assert fits(LONG, 101 * enough)


def test_a_time_with_room_for_trials_trains_what_no_budget_does(sixteen):
    free, timed = (
        reconstruct(sixteen, TrainingRequest(budget=Budget.of(budget), name=name))
        for budget, name in ((None, "free"), (900.0, "timed"))
    )
    assert store.sha256(timed / "splats.ply") == store.sha256(free / "splats.ply")
    assert read_model(timed).rungs == read_model(free).rungs
    assert any("views held out of both" in rung.reason for rung in read_model(timed).rungs)


def test_a_time_without_room_leaves_them_out_and_says_so(sixteen, monkeypatch):
    monkeypatch.setattr("recon.decide.decisions.has_time_for_trials", lambda *_, **__: False)
    said = []
    record = read_model(
        reconstruct(sixteen, TrainingRequest(budget=Budget(600.0, "s")), on_message=said.append)
    )
    assert not any("held out of both" in rung.reason for rung in record.rungs)
    assert any("take its time from the budget" in rung.reason for rung in record.rungs)
    assert "600 s leave no room for trials of what the scene needs." in said


@pytest.mark.parametrize(("amount", "unit"), [(35.0, "dB"), (1e6, "bytes"), (400.0, "Gaussians")])
def test_other_budgets_leave_time_for_corrections(toy_long, monkeypatch, amount, unit):
    monkeypatch.setattr("recon.decide.steps.corrections.TRIAL_LOOKS", 1)
    monkeypatch.setattr("recon.decide.steps.corrections.TRIAL_GAUSSIANS", 100)
    monkeypatch.setattr("recon.decide.held_out_evidence.STEPS", 4)
    wanted = settings(iterations=5, budget=amount, budget_unit=unit)
    assert all(rung.gain is not None for rung in rungs_of(toy_long, wanted))

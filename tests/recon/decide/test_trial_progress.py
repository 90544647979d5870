"""Trials before a training show one length for all of them, so that the time left does not grow."""

import pytest

from recon.data.dataset import Dataset
from recon.decide.steps import corrections, size
from recon.decide.steps.size import Ladder
from recon.decide.trials import Trials
from recon.observe.refinement import Refined

from .runs import settings

Reports = list[tuple[str, int, int]]


@pytest.fixture
def shown(monkeypatch: pytest.MonkeyPatch) -> Reports:
    """Progress that is shown of trials; all of them are short."""
    monkeypatch.setattr(corrections, "TRIAL_LOOKS", 1)
    monkeypatch.setattr(corrections, "TRIAL_GAUSSIANS", 100)
    monkeypatch.setattr("recon.decide.held_out_evidence.STEPS", 3)
    monkeypatch.setattr(corrections, "STEPS", 3)
    monkeypatch.setattr(size, "STEPS", 3)
    return []


def of_trials(reports: Reports) -> Reports:
    return [report for report in reports if report[0].startswith(("a trial", "judging"))]


def require_one_length(reports: Reports) -> None:
    assert len({total for _, _, total in reports}) == 1
    places = [done for _, done, _ in reports]
    assert places == sorted(places)


def test_trials_of_corrections_have_one_length(toy_long: Dataset, shown: Reports) -> None:
    names: tuple[Refined, ...] = ("poses", "exposures", "vignetting")
    corrections.tried(
        toy_long, names, settings(iterations=5, max_width=64), lambda *report: shown.append(report)
    )
    reports = of_trials(shown)
    require_one_length(reports)
    assert reports[-1][1] == reports[-1][2]
    assert {message for message, _, _ in reports} > {"a trial without corrections", "judging corrected poses"}


def test_trials_of_the_number_of_gaussians_have_one_length(toy_long: Dataset, shown: Reports) -> None:
    trials = Trials.from_new_points(toy_long, settings(), 200, lambda *report: shown.append(report))
    Ladder(trials, ["poses"], 200, 0).climbed()
    reports = of_trials(shown)
    require_one_length(reports)
    assert reports[-1][1] <= reports[-1][2]

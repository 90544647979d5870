"""Duration of a reconstruction, stated before it begins, from counts of its work."""

import shutil

import pytest

from recon.data.pixels import ShotSource
from recon.decide.cost.budget import Budget
from recon.decide.cost.duration import SURE, WORTH_SAYING, Work, how_long, words
from recon.decide.overrides import Overrides
from recon.decide.presets import QUALITIES, Quality
from recon.decide.request import TrainingRequest
from recon.reconstruct import reconstruct
from recon.train import trainer


@pytest.fixture
def counted(monkeypatch):
    """Forecast, the megapixels of files that were read, and the number of iterations."""
    counts = {"work": [], "files": [], "iterations": []}
    read, loss = ShotSource._read, trainer._loss

    def reading(*arguments):
        shot = read(*arguments)
        counts["files"].append(shot[2][0] * shot[2][1] / 1e6)
        return shot

    def step(*arguments):
        counts["iterations"].append(1)
        return loss(*arguments)

    monkeypatch.setattr(ShotSource, "_read", reading)
    monkeypatch.setattr(trainer, "_loss", step)
    monkeypatch.setattr(Work, "clock_seconds", lambda self, *_: counts["work"].append(self) or (0.0, 0.0))
    return counts


def test_a_draft_does_what_was_counted(session_copy, monkeypatch, counted):
    monkeypatch.setitem(QUALITIES, "draft", Quality(20, 200, 64))
    reconstruct(session_copy, TrainingRequest(quality="draft"))
    (work,) = counted["work"]
    assert (work.train, work.held_out, work.trials, work.small_trials) == (5, 1, 0, 0)
    assert work.iterations == len(counted["iterations"]) == 20
    assert work.files == pytest.approx(sum(counted["files"]))
    assert (work.view, work.planes) == (pytest.approx(64 * 48 / 1e6), 3)
    reconstruct(session_copy, TrainingRequest(quality="draft"))  # it is there
    assert len(counted["work"]) == 1


def test_trials_make_no_more_iterations_than_were_counted(toy_long, tmp_path, monkeypatch, counted):
    monkeypatch.setitem(QUALITIES, "standard", Quality(30, 400, 64))
    monkeypatch.setattr("recon.decide.steps.corrections.TRIAL_LOOKS", 2)
    monkeypatch.setattr("recon.decide.steps.corrections.TRIAL_GAUSSIANS", 400)
    monkeypatch.setattr("recon.decide.held_out_evidence.STEPS", 2)
    reconstruct(shutil.copytree(toy_long.session, tmp_path / "session"))
    (work,) = counted["work"]
    made, most = len(counted["iterations"]) - work.iterations, work.trials + work.small_trials
    assert most / 4 <= made <= most


def test_a_budget_counts_no_more_gaussians_than_pixels(toy_dataset, counted):
    firsts = list({view.camera: view for view in toy_dataset.views}.values())
    counts = {view.camera: (4, 3) for view in firsts}
    request = TrainingRequest(budget=Budget.of("300MB"))
    assert how_long(toy_dataset.session, firsts, counts, request) is None
    (work,) = counted["work"]
    assert work.gaussians == sum(3 * view.lens.width * view.lens.height for view in firsts)


def test_views_left_out_by_hand_are_not_counted_as_trained_on(toy_dataset, counted):
    firsts = list({view.camera: view for view in toy_dataset.views}.values())
    counts = {view.camera: (500, 440) for view in firsts}
    request = TrainingRequest(overrides=Overrides(views=20))
    assert how_long(toy_dataset.session, firsts, counts, request) is None
    (work,) = counted["work"]
    assert (work.train, work.held_out) == (20, 60 * len(firsts))
    assert work.iterations == QUALITIES["standard"].iterations_of(20)
    assert work.gaussians == QUALITIES["standard"].gaussians_of(20)


def test_exposures_left_out_by_hand_are_not_counted(toy_dataset, counted):
    firsts = list({view.camera: view for view in toy_dataset.views}.values())
    counts = {view.camera: (500, 440) for view in firsts}
    request = TrainingRequest(overrides=Overrides(exposures=1))
    assert how_long(toy_dataset.session, firsts, counts, request) is None
    (work,) = counted["work"]
    assert work.planes == 1  # of mosaics


def work(train: int, held_out: int, files: float, view: float, planes: float, **how: int) -> Work:
    return Work(
        train, held_out, files, view, planes, how["iterations"], how["gaussians"], how.get("trials", 0),
        how.get("small_trials", 0), min(view, 0.0768), 320,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("done", "took"),
    [
        (work(44, 6, 103, 0.182, 3, iterations=440, gaussians=20_000), 46),
        (work(9, 2, 66, 0.307, 3, iterations=2000, gaussians=40_000), 120.6),
        (
            work(21, 3, 6, 0.0768, 3, iterations=2000, gaussians=40_000, trials=1200, small_trials=2200),
            74.6,
        ),
        (
            work(21, 3, 9, 0.0768, 15, iterations=2000, gaussians=40_000, trials=1200, small_trials=2200),
            179.3,
        ),
    ],
    ids=["fox", "castle", "demo", "photographs of the demo"],
)
def test_what_was_measured_lies_within_what_is_said(done, took):
    """On two cores: fox from Enter to the report, the trainings of bench/results/presets.md; the castle by
    its 178.6 processor seconds beside other work.
    """
    line = done.in_words(2)
    low, high = (0.675 * sure * s for sure, s in zip(SURE, done.processor_seconds(), strict=True))
    assert low < took < high < 6 * low
    assert f"this takes {words(low)} to {words(high)} in all" in line
    assert f"this takes at most {words(high)} in all" in done.in_words(2, at_most=True)


def test_more_cores_take_less_and_a_toy_gets_no_word():
    long = work(44, 6, 103, 0.182, 3, iterations=4400, gaussians=20_000)
    assert "on 1 core: this takes 2 min to 6 min in all" in long.in_words(1)
    assert "on 16 cores: this takes 55 s to 2 min in all" in long.in_words(16)
    assert work(5, 1, 0.05, 0.003, 3, iterations=60, gaussians=400).clock_seconds(2)[1] < WORTH_SAYING


def test_other_work_on_the_machine_is_in_what_is_said():
    long = work(44, 6, 103, 0.182, 3, iterations=4400, gaussians=20_000)
    low, high = (4 * seconds for seconds in long.clock_seconds(2))
    assert f"this takes {words(low)} to {words(high)} in all" in long.in_words(2, free=0.25)
    assert long.in_words(2, free=0.25).endswith("if other work leaves 25 % of the cores, as now.")
    assert long.in_words(2, free=0.9).endswith("if nothing else runs here.")


@pytest.mark.parametrize(
    ("seconds", "said"), [(2, "5 s"), (43, "45 s"), (100, "2 min"), (5400, "1 h 30 min")]
)
def test_times_are_round(seconds, said):
    assert words(seconds) == said

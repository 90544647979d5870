"""Parsing of budgets, refusals, and predictions."""

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
import torch

from imaging.errors import InputError
from imaging.files import store
from recon.decide.cost.budget import Budget
from recon.decide.cost.prediction import ENOUGH, NOISE, SCENES, corrected, enough, gains, lacking, predicted
from recon.scene.appearance import LuminanceChromaticity
from recon.scene.gaussians import Gaussians
from recon.scene.ply import most_gaussians, plain_harmonics, write_ply
from tests.recon.ply_files import read_ply


def recorded():
    """The learning curves of bench/recon/learning_curves.py."""
    return store.read_json(Path(__file__).parents[4] / "bench" / "results" / "learning_curves.json")["rows"]


@pytest.fixture
def toy_scene():
    """Three Gaussians and their appearance."""
    appearance = LuminanceChromaticity()
    colours = torch.tensor([[0.1, 0.2, 0.3], [1.0, 0.5, 0.2], [4.0, 4.0, 4.0]])
    geometry = {
        "means": torch.zeros(3, 3),
        "log_scales": torch.zeros(3, 3),
        "quats": torch.ones(3, 4),
        "opacity_logits": torch.zeros(3),
    }
    return Gaussians(geometry | appearance.start(colours)), appearance


@pytest.mark.parametrize(
    ("text", "amount", "unit"),
    [
        ("90", 90, "s"),
        ("90s", 90, "s"),
        ("1.5m", 90, "s"),
        (" 5 m ", 300, "s"),
        ("2h", 7200, "s"),
        ("300MB", 300e6, "bytes"),
        ("2GB", 2e9, "bytes"),
        ("64KB", 64e3, "bytes"),
        ("100k", 100_000, "Gaussians"),
        ("35dB", 35, "dB"),
    ],
)
def test_every_kind_is_read_and_written_again(text, amount, unit):
    budget = Budget.parse(text)
    assert (budget.amount, budget.unit) == (amount, unit)
    assert Budget.parse(str(budget)) == budget


@pytest.mark.parametrize(
    "text", ["", "s", "5 parsecs", "5M", "5mb", "-3s", "0s", "0.0m", "nan", "inf", "1e400s", "9" * 400,
             "1KB", "0k", "0dB", "100dB", "35 db", "90s 5m"],
)  # fmt: skip
def test_nonsense_is_refused_in_one_sentence(text):
    with pytest.raises(InputError) as caught:
        Budget.parse(text)
    message = str(caught.value)
    assert message.startswith("A ")
    assert message.endswith(".")
    assert message.count("\n") == 0


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_the_file_of_that_many_gaussians_is_no_larger(toy_scene, tmp_path, degree):
    gaussians, appearance = toy_scene
    size = 100_000
    count = most_gaussians(size, degree)
    index = [i % len(gaussians) for i in range(count)]
    path = tmp_path / "splats.ply"
    copied = Gaussians(gaussians.rows(index))
    harmonics = plain_harmonics(copied, appearance, degree)
    write_ply(path, copied, harmonics, ["a note that is as long as notes are" * 3])
    assert len(read_ply(path)["x"]) == count
    assert 0.97 * size < path.stat().st_size <= size
    assert Budget(size, "bytes").gaussians == most_gaussians(size, 0) >= count


def test_forecasts_hold_as_often_as_they_say():
    """Scenes with the curves that are known, trained with noise: how often the truth is inside is known."""
    rng = np.random.Generator(np.random.PCG64(5))
    for tried, longer in ((25, 400), (100, 800), (200, 200), (300, 4000)):
        inside, errors = [], []
        for _ in range(300):
            scene_curve = rng.choice(SCENES, axis=0)[None]
            begun, reached = (
                40 - float(lacking(scene_curve, n)[0]) + NOISE * rng.standard_normal()
                for n in (tried, longer)
            )
            forecast = predicted(begun, tried, longer)
            inside.append(forecast.low <= reached <= forecast.high)
            errors.append(forecast.db - reached)
        assert 0.88 <= np.mean(inside) <= 0.99
        assert abs(np.mean(errors)) < 0.3


def test_the_more_was_tried_the_surer_is_what_is_told():
    near, far = (predicted(35.0, 100, n) for n in (200, 1600))
    assert 35 < near.db < far.db
    assert near.high - near.low < far.high - far.low
    later = predicted(35.0, 400, 1600)
    assert later.high - later.low < far.high - far.low


@pytest.mark.parametrize("db", [-100.0, 0.0, 100.0])
@pytest.mark.parametrize(("tried", "longer"), [(1, 10**7), (5000, 50)])
def test_what_is_predicted_is_finite(db, tried, longer):
    forecast = predicted(db, tried, longer)
    assert np.isfinite([forecast.db, forecast.low, forecast.high]).all()
    assert forecast.low < forecast.db < forecast.high


def test_enough_is_where_scenes_gain_little_more():
    assert [enough(n) for n in (1, 2, 20)] == [1, 2, 20]
    for n in (300, 2000, 4000, 10**6):
        fewer = enough(n)
        assert gains(fewer, n).mean() < ENOUGH <= gains(fewer - 1, n).mean()
        assert fewer < n
    assert enough(4000) < 2000 < enough(10**6) < 6000


def test_the_curves_of_scenes_are_those_that_were_measured():
    assert np.array_equal(SCENES, [row["fit"] for row in recorded()])


def test_scenes_of_other_kinds_predict_those_that_were_measured():
    inside = []
    for row in recorded():
        others = [other["fit"] for other in recorded() if other["kind"] != row["kind"]]
        for (tried, db), (longer, reached) in combinations(row["curve"], 2):
            forecast = predicted(db, tried, longer, others)
            inside.append(forecast.low <= reached <= forecast.high)
    assert len(inside) > 500
    assert 0.85 <= np.mean(inside) <= 0.99


def test_the_interval_of_a_time_covers_a_machine_that_gets_busy():
    """The same scene, on a machine that has half the time for it or half as much again."""
    rng = np.random.Generator(np.random.PCG64(6))
    inside = {True: [], False: []}
    for _ in range(300):
        scene_curve = rng.choice(SCENES, axis=0)[None]
        begun = 40 - float(lacking(scene_curve, 25)[0]) + NOISE * rng.standard_normal()
        reached = (
            40 - float(lacking(scene_curve, rng.choice((100, 200, 300)))[0]) + NOISE * rng.standard_normal()
        )
        for timed, hits in inside.items():
            forecast = predicted(begun, 25, 200, timed=timed)
            hits.append(forecast.low <= reached <= forecast.high)
    assert np.mean(inside[False]) < np.mean(inside[True])
    assert np.mean(inside[True]) >= 0.93


def test_a_training_that_came_out_shorter_has_another_forecast():
    guess = predicted(30.0, 25, 400, timed=True)
    assert corrected(guess, 390) is None
    less = corrected(guess, 60)
    assert less is not None
    assert less.db < guess.db
    assert (less.iterations, less.tried, less.tried_db) == (60, 25, 30.0)

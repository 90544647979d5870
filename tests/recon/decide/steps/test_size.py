"""The number of Gaussians and the degree of their colours: by samples, by trials, as asked, and resumed."""

import os
import signal
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import recon.decide.steps.size as module
from bench.support import oracle
from drivers.sim.rig_settings import RIGS
from imaging.files import store
from imaging.progress import unreported
from recon.data.light import light_of, radiance_image
from recon.data.load import load
from recon.decide.evidence import Evidence
from recon.decide.overrides import Overrides
from recon.decide.presets import QUALITIES, Quality
from recon.decide.request import TrainingRequest
from recon.decide.settings import Settings
from recon.decide.steps.size import (
    COLOUR,
    COUNT,
    Ladder,
    degree_for,
    fewer,
    fewest,
    gaussians_for,
    lowest,
    most_for,
)
from recon.decide.steps.view_dependence import Gains
from recon.decide.trials import Trials, reason_against_trials
from recon.reconstruct import reconstruct
from recon.result.model import read_model
from recon.result.opened import open_model
from recon.scene.ply import most_gaussians
from recon.start.initialisation import Start, start_points

from ..runs import run_of

QUICK = Quality(80, 800, 64)


@pytest.fixture(scope="module")
def long(tmp_path_factory):
    """Sixteen views of the toy rig with their true calibration."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(RIGS, "toy-long", replace(RIGS["toy"], positions=8))
        return oracle.oracle_session(tmp_path_factory.mktemp("toy") / "toy", "toy-long", points=600)


@pytest.fixture(scope="module")
def many(long):
    return load(long)


def settings(**changed) -> Settings:
    return Settings(
        **{"method": "nh-3dgs", "quality": "standard", "seed": 0, "iterations": 2000}
        | {"max_gaussians": 20_000, "max_width": 640}
        | changed
    )


def decide(dataset, wanted):
    """The number of Gaussians, the degree, and the rung of each."""
    images = [radiance_image(view) for view in dataset.train]
    rng = np.random.Generator(np.random.PCG64(0))
    run, evidence = run_of(dataset, wanted), Evidence(dataset, images, light_of(dataset, images), 0.0)
    degree, colour = degree_for(run, evidence)
    points = start_points(dataset, images, most_for(dataset, wanted, degree) // 2, rng)
    against = reason_against_trials(dataset, wanted)
    count, number = gaussians_for(run, evidence, wanted, against, degree, (), points)
    return count, degree, number, colour


def test_the_fewest_lie_where_the_curve_crosses_the_line(monkeypatch):
    monkeypatch.setattr(module, "LOSS", 0.2)
    assert fewest([800, 400, 200], [30.0, 29.9, 29.7]) == int(200 * 2**0.5)
    assert fewest([800, 400], [30.0, 29.6]) == int(800 / 2**0.5)
    assert fewest([800, 400, 200], [30.0, 31.0, 30.9]) == 200
    assert fewest([800], [30.0]) == 800


def test_a_scene_is_given_no_more_gaussians_than_its_trials_name(monkeypatch):
    """However much longer the whole training is: the gallery, trials of 400 iterations for one of 4,000."""
    trials = SimpleNamespace(settings=settings(iterations=4000), part=SimpleNamespace(held_out=()))
    ladder = Ladder(trials, (), 80_000, 0)
    db_of = {80_000: 42.54, 40_000: 42.93, 20_000: 42.57}
    monkeypatch.setattr(Ladder, "db", lambda self, count: np.array([db_of[count], db_of[count]]))
    count, rung = ladder.climbed()
    assert 20_000 < count < 30_000
    assert rung.taken
    assert "42.93 dB with 40,000" in rung.reason


def test_fewer_points_are_those_of_the_surfaces_first():
    xyz = np.arange(60.0).reshape(20, 3)
    points = Start(xyz, xyz / 64, sparse=8)
    assert fewer(points, 20, 0) is points
    some, most = fewer(points, 5, 0), fewer(points, 12, 0)
    assert (len(some.xyz), some.sparse) == (5, 5)
    assert some.xyz.max() < 24
    assert (len(most.xyz), most.sparse) == (12, 8)
    assert np.array_equal(most.xyz[:8], xyz[:8])
    assert len(np.unique(most.xyz)) == 36
    assert np.array_equal(most.rgb * 64, most.xyz)


def test_a_few_small_pictures_get_few_gaussians_of_one_colour(toy_dataset):
    count, degree, number, colour = decide(toy_dataset, settings())
    assert count == 5 * 64 * 48 // 2
    assert (number.name, number.taken) == (COUNT, True)
    assert "5 training views are too few" in number.reason
    assert (colour.name, colour.taken, colour.gain, degree) == (COLOUR, False, None, 0)
    assert colour.parameters == 0


@pytest.mark.parametrize(
    "wanted",
    [
        settings(max_gaussians=9000, overrides=Overrides(gaussians=9000)),
        settings(max_gaussians=9000, budget=9000.0, budget_unit="Gaussians"),
    ],
    ids=["set", "budget"],
)
def test_what_is_asked_for_is_obeyed(toy_dataset, wanted):
    count, _, number, _ = decide(toy_dataset, wanted)
    assert count == 9000
    assert number.reason == "at most 9,000, as asked for"
    assert not number.taken


def test_a_degree_that_is_asked_for_is_obeyed(toy_dataset):
    _, degree, _, colour = decide(toy_dataset, settings(overrides=Overrides(degree=0)))
    assert degree == 0
    assert not colour.taken


def test_colours_follow_the_direction_where_things_gloss(many):
    """The table's balls and mug do."""
    run = run_of(many, settings())
    degree, rung = degree_for(run, Evidence.of(run))
    assert degree > 0
    assert rung.taken
    assert rung.gain > rung.standard_error > 0
    assert rung.parameters == {1: 9, 2: 24}[degree]


@pytest.mark.parametrize(
    ("db", "error", "degree"),
    [
        ((0.0, 0.4, 0.4), 0.1, 0),
        ((0.0, 0.5, 0.5), 0.1, 0),
        ((0.0, 0.6, 0.8), 0.1, 1),
        ((0.0, 1.5, 1.9), 0.1, 2),
        ((0.0, 0.4, 0.6), 0.1, 1),
        ((0.0, 0.9, 1.8), 0.1, 2),
        ((0.0, 0.9, 1.8), 2.0, 0),
    ],
    ids=["matte", "not surely", "simple", "some gloss", "only together", "gloss", "chance"],
)
def test_a_degree_is_taken_where_it_gains_what_matters_and_more_than_chance(db, error, degree):
    assert lowest(Gains(100, np.array(db), np.full((3, 3), error))) == degree


def test_a_budget_in_bytes_has_room_for_more_gaussians_of_one_colour(many):
    wanted = settings(max_gaussians=50_000, budget=1e6, budget_unit="bytes")
    counts = [most_for(many, wanted, degree) for degree in range(3)]
    assert counts == [most_gaussians(1e6, degree) for degree in range(3)]
    assert counts[0] > 2 * counts[2]


@pytest.mark.parametrize(
    ("views", "changed", "count"),
    [
        (12, {}, 18_000),
        (7, {}, 10_500),
        (4, {}, 10_000),
        (12, {"quality": "draft"}, 20_000),
        (12, {"overrides": Overrides(gaussians=20_000)}, 20_000),
        (13, {"overrides": Overrides(width=48)}, 20_000),
    ],
)
def test_views_too_few_for_trials_have_room_for_fewer_gaussians(many, views, changed, count, monkeypatch):
    """But for drafts, what is set by hand, and views enough for trials."""
    monkeypatch.setattr(module, "room", lambda dataset: 1_000_000)
    few = replace(many, train=many.train[:views])
    assert len(few.train) == views
    wanted = settings(**changed)
    run = run_of(few, wanted)
    most, rung = gaussians_for(run, Evidence.of(run), wanted, reason_against_trials(few, wanted), 0, (), None)
    assert (most, rung.taken) == (count, count < 20_000)
    assert ("1,500 for each training view" in rung.reason) == (count < 20_000)


def test_as_few_as_are_as_good(many, monkeypatch):
    """All halvings are taken where none loses."""
    monkeypatch.setattr(module.Ladder, "db", lambda self, count: np.full(4, 30.0))
    wanted = settings(max_gaussians=1600)
    run = run_of(many, wanted)
    count, number = gaussians_for(run, Evidence.of(run), wanted, None, 1, (), None)
    assert count == 1600 // 2**module.MOST_HALVINGS == 50
    assert number.taken


def test_trials_choose_once_for_a_training_that_is_resumed(long, many, monkeypatch):
    """An interrupted training takes its decision along, and ends bit for bit like one that was not."""
    monkeypatch.setitem(QUALITIES, "standard", QUICK)
    monkeypatch.setattr(module, "TRIAL_SHARE", 0.2)
    overrides = Overrides(refine="none")
    whole = reconstruct(long, TrainingRequest(overrides=overrides, name="whole"))
    model = read_model(whole)
    rungs = {rung.name: rung for rung in model.rungs}
    assert model.settings.max_gaussians < QUICK.gaussians
    assert model.gaussians <= model.settings.max_gaussians
    assert rungs[COUNT].taken
    assert rungs[COUNT].gain is not None
    assert rungs[COLOUR].taken == (model.settings.degree > 0)
    assert open_model(whole).training.method.degree(1.0) == model.settings.degree

    def interrupt(message, done, total):
        if "loss" in message and done < total:
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        reconstruct(long, TrainingRequest(overrides=overrides, name="twice"), on_progress=interrupt)
    monkeypatch.setattr("recon.reconstruct.planned", lambda *_: pytest.fail("tried again"))
    again = reconstruct(long, TrainingRequest(overrides=overrides, name="twice"))
    assert (again / "splats.ply").read_bytes() == (whole / "splats.ply").read_bytes()
    assert store.read_json(again / "model.json")["rungs"] == store.read_json(whole / "model.json")["rungs"]
    assert reconstruct(long, TrainingRequest(overrides=overrides, name="twice")) == again


def test_trials_see_no_view_that_judges_and_none_that_is_held_out(many):
    trials = Trials.from_new_points(many, settings(), 500, unreported)
    trained, judged = ({view.name for view in views} for views in (trials.part.train, trials.judged))
    assert len(judged) >= 4
    assert not trained & judged
    assert trained | judged == {view.name for view in many.train}
    assert not judged & {view.name for view in many.held_out}

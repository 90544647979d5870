"""Use of measured depth: where it fits the scene points, and where held-out views gain."""

import os
import signal
from dataclasses import replace

import numpy as np
import pytest

from bench.support.depths import add_depths
from imaging.errors import InputError
from imaging.files import store
from imaging.files.colmap import pycolmap
from imaging.files.photo import encode_png
from imaging.progress import unreported
from recon.data.light import radiance_image
from recon.data.load import load
from recon.data.measured_depth import DepthFit
from recon.decide.decisions import decide
from recon.decide.evidence import Evidence, depth_fit
from recon.decide.overrides import Overrides
from recon.decide.request import TrainingRequest
from recon.decide.steps.depth_weight import START, TERM, USUAL, depth_for, tried
from recon.reconstruct import reconstruct
from recon.result.model import MODEL, SPLATS

from ..runs import run_of, settings


@pytest.fixture(scope="module")
def deep(toy_deep):
    return load(toy_deep)


def decided_of(dataset, **overrides):
    run = run_of(dataset, settings(overrides=Overrides(**overrides)))
    evidence = Evidence.of(run)
    decided = decide(run, evidence)
    return evidence, decided, {rung.name: rung for rung in decided.rungs if rung.name in (START, TERM)}


def test_sessions_without_maps_have_no_rungs_of_them(toy_dataset):
    evidence, decided, rungs = decided_of(toy_dataset)
    assert rungs == {}
    assert evidence.depths is None
    assert (decided.settings.depth, decided.settings.depth_scale) == (0.0, None)


def test_where_no_trial_can_be_made_scene_points_decide(deep):
    _, decided, rungs = decided_of(deep)
    assert rungs[START].taken
    assert "times what their unit says" in rungs[START].reason
    assert rungs[TERM].taken
    words = "less than 3 %, 5 training views are few; a trial: not tried, since 5 training views"
    assert words in rungs[TERM].reason
    assert decided.settings.depth == USUAL
    assert decided.settings.depth_scale == pytest.approx(1.0, abs=0.01)


def test_without_a_trial_many_views_and_scattered_maps_go_without_the_term(deep):
    good = DepthFit(views=5, scale=1.0, scatter=0.01, looks=500)
    many = replace(deep, train=deep.train * 3)
    run = run_of(deep, settings())
    evidence = Evidence.of(run)
    for dataset, fitted, words in (
        (many, good, "15 training views are enough without it"),
        (deep, replace(good, scatter=0.05), "differ by more than 3 %"),
    ):
        known = replace(evidence, dataset=dataset, depths=fitted)
        weight, rungs = depth_for(run, known, settings(), "no time")
        assert weight == 0
        assert [rung.taken for rung in rungs] == [True, False]
        assert words in rungs[1].reason


def test_it_is_left_out_or_weighed_as_asked_for(deep):
    evidence, decided, rungs = decided_of(deep, depth=0)
    assert [rung.reason for rung in rungs.values()] == ["left out, as asked for"]
    assert (decided.settings.depth, decided.settings.depth_scale) == (0.0, None)
    assert all(view.depth is None for view in evidence.dataset.train)
    _, decided, rungs = decided_of(deep, depth=0.2)
    assert decided.settings.depth == 0.2
    assert rungs[TERM].reason == "asked for with a weight of 0.2"
    with pytest.raises(InputError, match="--set depth=-1 cannot be used"):
        Overrides.of(["depth=-1"])


def test_maps_of_another_scene_are_left_out_and_told(deep, session_copy):
    add_depths(session_copy, noise=0.5, holes=0.2, seed=0)
    evidence, decided, rungs = decided_of(load(session_copy))
    assert list(rungs) == [START]
    assert not rungs[START].taken
    assert "they are of another scene, or in units of their own" in rungs[START].reason
    assert decided.settings.depth == 0
    assert all(view.depth is None for view in evidence.dataset.views)


@pytest.mark.parametrize(("unit", "scale"), [(1e-3, 1.0), (0.4e-3, 0.4)])
def test_poses_without_points_have_a_sweep_tell_the_unit(session_copy, unit, scale):
    add_depths(session_copy, noise=0.01, holes=0.2, seed=0, unit=unit)
    pycolmap.Reconstruction().write(str(session_copy / "calibration" / "colmap"))
    dataset = load(session_copy)
    assert not len(dataset.points().xyz)
    fitted = depth_fit(dataset, [radiance_image(view) for view in dataset.train], unreported)
    assert fitted.fits
    assert fitted.scale == (scale if scale == 1 else pytest.approx(scale, rel=0.04))


def test_a_trial_is_judged_on_views_of_its_own(toy_long, monkeypatch, tmp_path):
    for name in ("TRIAL_LOOKS", "TRIAL_GAUSSIANS"):
        monkeypatch.setattr(f"recon.decide.steps.depth_weight.{name}", {"TRIAL_LOOKS": 2}.get(name, 200))
    weight, rung = tried(toy_long, settings(), (0.1, 0.5), unreported)
    # Nobody measured any depth here, and all three trainings are one.
    assert (weight, rung.gain, rung.standard_error, rung.taken) == (0.0, 0.0, 0.0, False)
    assert "with weights of 0, 0.1, 0.5, judged on 4 views held out of all" in rung.reason


def test_a_training_that_was_stopped_goes_on_with_its_depth(session_copy):
    add_depths(session_copy, noise=0.01, holes=0.2, seed=0, unit=0.5e-3)
    chosen = Overrides(iterations=30, gaussians=200, degree=0, refine="none", environment=False, depth=0.5)
    whole = reconstruct(session_copy, TrainingRequest(method="nh-3dgs", overrides=chosen, name="whole"))

    def interrupt(message: str, done: int, total: int) -> None:
        if "loss" in message and done < total:
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        reconstruct(
            session_copy,
            TrainingRequest(method="nh-3dgs", overrides=chosen, name="twice"),
            on_progress=interrupt,
        )
    again = reconstruct(session_copy, TrainingRequest(method="nh-3dgs", overrides=chosen, name="twice"))
    assert (again / SPLATS).read_bytes() == (whole / SPLATS).read_bytes()
    model = store.read_json(again / MODEL)
    assert model["settings"]["depth_scale"] == pytest.approx(0.5, rel=0.02)
    assert [rung["name"] for rung in model["rungs"] if rung["name"].startswith("depth")] == [START, TERM]
    assert 0 < store.read_json(whole / MODEL)["settings"]["depth"] == model["settings"]["depth"]


def test_a_map_that_went_missing_is_named(session_copy):
    add_depths(session_copy, noise=0.01, holes=0.2, seed=0)
    dataset = load(session_copy)
    broken = dataset.train[0].depth.path
    broken.write_bytes(encode_png(np.ones((48, 64), np.uint16))[:-20])
    with pytest.raises(InputError, match=r"The depth map .* is damaged or cut off: export it again\."):
        Evidence.of(run_of(dataset, settings()))

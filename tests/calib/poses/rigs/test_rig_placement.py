"""A view that shows nothing stands where its rig says, and the truth is within what is stated of it."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib.adjustment.bundle_adjustment import Free
from calib.calibrate import calibrate
from calib.data.features import Features
from calib.data.views import View
from calib.light import vignetting
from calib.light.radiometry import light_of
from calib.poses.pose_inputs import PoseInputs
from calib.poses.rigs.rig_placement import place_by_rig
from calib.poses.sfm import SceneModel, centres, solve
from calib.view_images import ViewSummary, summarise
from imaging.files import store
from imaging.files.raw import read_raw
from imaging.files.tiff.dng import write_dng
from imaging.optics.pose import Pose
from imaging.progress import unreported
from imaging.session.calibration import read_calibration
from imaging.session.session import Session
from imaging.session.view_id import ViewId
from recon.data.load import load
from recon.measure.truth import calibration_errors

from ..test_sfm import GUESS, arc, features_of

LOST = ViewId(2, "right")
RIGS = {"left": "rig", "right": "rig"}
INSIDE = 2.8
"""Standard errors about the worst axis that hold 95 of 100 errors in three dimensions."""


def shifted(name: str) -> np.ndarray:
    return np.array([0.15 if name == "left" else -0.15, 0, 0])


@pytest.fixture(scope="module")
def model() -> SceneModel:
    """Two cameras on an arc, one of which sees nothing at one frame."""
    features = {
        ViewId(frame, name): features_of(
            rotation, translation + shifted(name), seed=2 * frame + (name == "left")
        )
        for frame, (rotation, translation) in enumerate(arc(5))
        for name in RIGS
    }
    features[LOST] = Features(np.empty((0, 2)), np.empty((0, 128), np.uint8))
    return solve(PoseInputs(features, [list(RIGS)]), {"left": GUESS, "right": GUESS})


def test_a_lost_view_is_placed_within_its_stated_error(model: SceneModel) -> None:
    assert LOST not in model.poses
    filled, placed = place_by_rig(model, {*model.poses, LOST}, RIGS)
    assert placed == {LOST}
    assert filled.points[LOST] == 0
    assert filled.errors is not None
    truth = {
        ViewId(frame, name): np.column_stack([rotation, translation + shifted(name)])
        for frame, (rotation, translation) in enumerate(arc(5))
        for name in RIGS
    }
    keys = sorted(truth)
    estimated = np.stack([filled.poses[key].matrix()[:3] for key in keys])
    true = np.stack([truth[key] for key in keys])
    u, _, vt = np.linalg.svd(np.einsum("nji,njk->ik", true[:, :, :3], estimated[:, :, :3]))
    turn = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    angles = np.linalg.norm(estimated[:, :, :3] @ turn.T - true[:, :, :3], axis=(1, 2)) / np.sqrt(2)
    here = centres([filled.poses[key] for key in keys]) @ turn.T
    there = np.stack([-pose[:, :3].T @ pose[:, 3] for pose in true])
    here, there = here - here.mean(0), there - there.mean(0)
    scale = (here * there).sum() / (here**2).sum()
    misses = np.linalg.norm(here - there / scale, axis=1)
    at = keys.index(LOST)
    assert np.degrees(angles[at]) < INSIDE * filled.errors.rotation[LOST] < 0.3
    assert misses[at] < INSIDE * filled.errors.translation[LOST] < 0.05 * np.ptp(here)
    beside = ViewId(LOST.frame, "left")
    assert filled.errors.rotation[LOST] > 1.2 * filled.errors.rotation[beside]
    assert filled.errors.translation[LOST] > 1.2 * filled.errors.translation[beside]
    (rung,) = (rung for rung in filled.rungs if rung.name == "rig_placing")
    assert "0002/right" in rung.reason


def test_what_no_rig_ties_stays_lost(model: SceneModel) -> None:
    every = {*model.poses, LOST}
    for rigs in ({}, {"left": "one", "right": "other"}):
        assert place_by_rig(model, every, rigs) == (model, frozenset())
    assert place_by_rig(replace(model, cam_from_rig={}), every, RIGS)[1] == frozenset()
    nobody = {key: pose for key, pose in model.poses.items() if key.frame != LOST.frame}
    assert place_by_rig(replace(model, poses=nobody), nobody.keys() | {LOST}, RIGS)[1] == frozenset()


def test_a_model_too_poor_to_say_how_sure_it_is_places_all_the_same(model: SceneModel) -> None:
    filled, placed = place_by_rig(replace(model, errors=None), [*model.poses, LOST], RIGS)
    assert placed == {LOST}
    assert filled.errors is None
    assert isinstance(filled.poses[LOST], Pose)


def test_an_error_is_stated_as_far_as_other_views_have_one(model: SceneModel) -> None:
    def filled(*without: ViewId) -> SceneModel:
        assert model.errors is not None
        rotation, translation = (
            {view: error for view, error in errors.items() if view not in without}
            for errors in (model.errors.rotation, model.errors.translation)
        )
        errors = replace(model.errors, rotation=rotation, translation=translation)
        full, placed = place_by_rig(replace(model, errors=errors), {*model.poses, LOST}, RIGS)
        assert placed == {LOST}
        return full

    some = filled(ViewId(0, "left"), ViewId(0, "right")).errors
    assert some is not None
    assert LOST in some.rotation
    assert LOST in some.translation
    for without in ([ViewId(LOST.frame, "left")], [view for view in model.poses if view.camera == "right"]):
        none = filled(*without).errors
        assert none is not None
        assert LOST not in none.rotation
        assert LOST not in none.translation


def test_black_pictures_of_one_camera_are_listed_as_placed_by_the_rig(
    own_arm: Path, arm_looks: dict[ViewId, ViewSummary], monkeypatch: pytest.MonkeyPatch
) -> None:
    def looked(session: Session, view: View, *rest: Any) -> ViewSummary:
        return summarise(session, view, *rest) if view.id == ViewId(1, "cam1") else arm_looks[view.id]

    monkeypatch.setattr("calib.view_images.summarise", looked)
    rng = np.random.default_rng(1)
    for file in sorted((own_arm / "raw" / "0001").glob("cam1_*.dng")):
        raw = read_raw(file)
        noise = raw.black[0][0] + 2 * rng.standard_normal(raw.pixels.shape)
        write_dng(file, replace(raw, pixels=np.rint(noise).clip(0).astype(np.uint16)))
    shots = store.read_lines(own_arm / "shots.jsonl")
    (own_arm / "shots.jsonl").unlink()
    for shot in shots:
        if shot["camera"] in ("cam0", "cam1"):
            store.append_line(own_arm / "shots.jsonl", shot)
    light = light_of(read_calibration(own_arm), ())
    monkeypatch.setattr("calib.light.radiometry.measure_light", lambda *rest: light)
    monkeypatch.setattr("calib.poses.adjusted.climb", lambda *rest: (Free(), ()))
    none = vignetting.Falloff(
        {"cam0": (0.0, 0.0, 0.0), "cam1": (0.0, 0.0, 0.0)}, {"cam0": 1.0, "cam1": 1.0}, ()
    )
    monkeypatch.setattr(vignetting, "estimate", lambda *rest, **more: none)
    record = calibrate(own_arm, on_progress=unreported)
    assert record.unregistered == ()
    (lost,) = (view for view in record.views if view.by_rig)
    assert (lost.camera, lost.frame, lost.points) == ("cam1", 1, 0)
    assert lost.error is not None
    others = [view.error.rotation for view in record.views if view.error is not None and not view.by_rig]
    assert lost.error.rotation > max(error for error in others if error < lost.error.rotation)
    assert calibration_errors(own_arm, record)["pose_rotation_deg_max"] < INSIDE * lost.error.rotation
    data = load(own_arm)
    assert "0001/cam1" not in [view.name for view in data.views]
    assert len(data.views) == 5

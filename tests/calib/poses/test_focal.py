"""Focal lengths that the scene determines, and words for those of several cameras that it does not."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.adjustment.bundle_adjustment import Free, misses
from calib.calibrate import calibrate
from calib.poses import focal
from calib.sensor.focal_length import FocalLength
from capture.imports.photos import import_photos
from imaging.files.colmap import pycolmap
from imaging.files.photo import encode_png
from tests import painted_room
from tests.calib.adjustment.test_uncertainty import made

NAMES = {1: "cam1", 2: "cam2"}


@pytest.mark.parametrize(
    ("stated", "words"),
    [
        ({}, "no file states it either, and it may be off by up to 44 %"),
        ({"cam1": 0.02, "cam2": 0.03}, "the stated ones are used, known to 3 %"),
        ({"cam1": 0.02}, "those stated are used where there are any, and they may be off by up to 42 %"),
    ],
)
def test_cameras_whose_focal_lengths_are_held_are_one_warning(monkeypatch, stated, words):
    monkeypatch.setattr(focal, "effect", lambda *_: {1: 0.001, 2: 0.002})
    model = pycolmap.Reconstruction(made(3))
    files = {name: FocalLength(640.0, spread, "35 mm") for name, spread in stated.items()}
    priors = focal.focal_priors({number: files[name] for number, name in NAMES.items() if name in files})
    free, (rung,) = focal.settle_focal(model, Free(focal=priors), 0.3, 1, NAMES, files)
    assert rung.taken
    assert rung.reason.startswith("these photographs of cam1, cam2 do not determine the focal length (10 %")
    assert "would move points by 0.002 px only" in rung.reason
    assert words in rung.reason
    assert all(prior.held for prior in free.focal.values())
    assert set(free.focal) == {1, 2}


def test_a_camera_that_the_scene_determines_is_not_held():
    model = made(3)
    free, rungs = focal.settle_focal(model, Free(), 0.3, 1, NAMES, {})
    assert free.focal == {}
    assert [rung.taken for rung in rungs] == [False, False]


@pytest.mark.parametrize(
    ("doubt", "expected", "spread"), [(10.0, 810, 0.45), (0.45, 2540, 0.32), (0.01, 7990, 0.01)]
)
def test_a_focal_length_is_drawn_towards_those_of_most_cameras(doubt, expected, spread):
    """As far as the points do not determine it: 8,000 px, where most cameras have 800."""
    px, doubtful = focal._likely(8000.0, doubt, 800.0)
    assert px == pytest.approx(expected, rel=0.02)
    assert doubtful == pytest.approx(spread, rel=0.02)


def test_a_focal_length_that_lenses_have_stays(monkeypatch):
    monkeypatch.setattr(focal, "effect", lambda *_: {1: 0.001, 2: 0.001})
    model = made(3)
    for number in NAMES:
        focal._lengthen(model, number, 3 * 640.0)
    free, _ = focal.settle_focal(model, Free(), 0.3, 1, NAMES, {})
    assert [prior.px for prior in free.focal.values()] == [3 * 640.0] * 2


def test_a_model_of_a_far_too_long_lens_comes_back(monkeypatch):
    """As of three photographs of books on a table, which a lens seven times too long fitted as well."""
    monkeypatch.setattr(focal, "effect", lambda *_: {1: 0.001, 2: 0.001})
    model = made(3)
    for number in NAMES:
        focal._lengthen(model, number, 6 * 640.0)
    focal.settle_focal(model, Free(), 0.3, 1, NAMES, {})
    for camera in model.cameras.values():
        assert camera.mean_focal_length() == pytest.approx(640, rel=0.2)
    assert misses(model).typical < 0.5


def test_a_walk_past_a_wall_is_not_sure_of_a_wrong_focal_length(tmp_path):
    """Turned about the vertical alone, it is the same walk for longer lenses: with two focal lengths and a
    middle aside it fitted to 0.03 px, each of them wrong by a fifth to a half.
    """
    photographs = tmp_path / "photographs"
    photographs.mkdir()
    for step in range(5):
        turn = Rotation.from_euler("xyz", [0, -4 * step, step], degrees=True)
        motion = np.eye(4)
        motion[:3, :3] = turn.as_matrix()
        motion[:3, 3] = -turn.apply([0.35 * step, 0.1 * (step % 2), 0.12 * step])
        (photographs / f"{step}.png").write_bytes(encode_png(painted_room.picture(motion)))
    import_photos(photographs, tmp_path / "session")
    record = calibrate(tmp_path / "session")
    (camera,) = record.cameras
    lens, error = camera.lens, camera.lens_error
    assert any("do not determine the focal length" in doubt for doubt in record.doubts)
    assert lens.fx == lens.fy
    assert abs(lens.fx - painted_room.FOCAL) < 3 * error.fx

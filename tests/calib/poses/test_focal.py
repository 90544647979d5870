"""Focal lengths that the scene determines, and words for those of several cameras that it does not."""

import pytest

from calib.adjustment.bundle_adjustment import Free
from calib.poses import focal
from calib.sensor.focal_length import FocalLength
from imaging.files.colmap import pycolmap
from tests.calib.adjustment.test_uncertainty import made

NAMES = {1: "cam1", 2: "cam2"}


@pytest.mark.parametrize(
    ("stated", "words"),
    [
        ({}, "no file states it either, and it may be off by up to 20 %"),
        ({"cam1": 0.02, "cam2": 0.03}, "EXIF's are used, known to 3 %"),
        ({"cam1": 0.02}, "EXIF's are used where files state them, and they may be off by up to 20 %"),
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

"""RealX3D's layout: what is imported of it, and where its cameras stand."""

import json

import numpy as np
import pytest

from capture.imports import layouts
from capture.imports.layouts.datasets import realx3d
from capture.imports.photos import import_photos
from imaging.errors import InputError
from imaging.session.calibration import read_calibration
from imaging.session.session import Session
from tests.rig.benchmarks.painted_wall import CENTRES
from tests.rig.benchmarks.realx3d_scene import TESTED, realx3d_scene


def test_degraded_photographs_train_and_clean_ones_of_other_poses_test(tmp_path):
    scene = realx3d_scene(tmp_path / "r")
    assert layouts.detect(scene) == "realx3d"
    result = import_photos(scene, tmp_path / "s")
    assert (result.layout, result.cameras, result.views) == ("realx3d", 1, 9)
    session = Session.open(tmp_path / "s")
    calibration = read_calibration(session.folder)
    numbers = {shot.frame: int(shot.source.rsplit("/", 1)[-1].split(".")[0]) - 1 for shot in session.shots()}
    assert {shot.source.split("/")[-2] for shot in session.shots()} == {"train", "test"}
    for view in calibration.views:
        motion = view.cam_from_world.matrix()
        x, y = CENTRES[numbers[view.frame]]  # of the model, not of the lists, whose world is smaller
        np.testing.assert_allclose(-motion[:3, :3].T @ motion[:3, 3], [x, y, 0], atol=1e-9)
    tested = {numbers[shot.frame] for shot in session.shots() if shot.file in session.split().test}
    assert tested == set(TESTED)


def test_a_scene_without_a_reference_of_each_photograph_is_no_such_scene(tmp_path):
    scene = realx3d_scene(tmp_path / "r")
    (scene / "val" / "0001.JPG").unlink()
    assert not realx3d.is_one(scene)


def test_damage_is_named(tmp_path):
    scene = realx3d_scene(tmp_path / "r")
    lists = scene / "transforms_train.json"
    whole = json.loads(lists.read_text())
    (scene / "train" / "0003.JPG").unlink()
    assert "0003.JPG is named in frame 1 of" in realx3d.read(scene).missing[0]
    lists.write_text(json.dumps(whole | {"frames": [whole["frames"][0]] * 2}))
    with pytest.raises(InputError, match=r"0001\.JPG a second time"):
        realx3d.read(scene)
    stranger = {"file_path": "train/0099.JPG"} | {"transform_matrix": np.eye(4).tolist()}
    (scene / "train" / "0099.JPG").write_bytes((scene / "train" / "0001.JPG").read_bytes())
    lists.write_text(json.dumps(whole | {"frames": [stranger]}))
    with pytest.raises(InputError, match="has no pose for"):
        realx3d.read(scene)
    for file in (scene / "sparse" / "0").iterdir():
        file.unlink()
    with pytest.raises(InputError, match="no COLMAP model"):
        realx3d.read(scene)

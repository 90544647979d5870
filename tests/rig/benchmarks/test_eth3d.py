"""`rig bench eth3d` on a painted room, in the layout of ETH3D's rigs."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.data import learned
from imaging.errors import CalibrationError
from imaging.files.colmap import pycolmap
from imaging.files.photo import encode_png
from imaging.session.session import Session
from tests.conftest import fewer_features
from tests.painted_room import FOCAL, HEIGHT, WIDTH, picture
from tests.rig.benchmarks.painted_wall import put

RIG = ("images_rig_cam4_undistorted", "images_rig_cam5_undistorted")
FRAMES = [([0.35 * n, 0.1 * (n % 2), 0.12 * n], [0, -4 * n, n]) for n in range(4)]


def eth3d_scene(folder: Path) -> Path:
    """Write two cameras 0.4 m apart at four moments, with the true model."""
    model, number = pycolmap.Reconstruction(), 0
    for key, camera in enumerate(RIG, start=1):
        lens = pycolmap.Camera.create_from_model_name(key, "PINHOLE", FOCAL, WIDTH, HEIGHT)
        lens.params = [FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2]
        model.add_camera_with_trivial_rig(lens)
        for moment, (centre, angles) in enumerate(FRAMES):
            number += 1
            turn = Rotation.from_euler("xyz", angles, degrees=True)
            motion = np.eye(4)
            motion[:3, :3] = turn.as_matrix()
            motion[:3, 3] = -turn.apply(centre) - [0.4 * (key - 1), 0, 0]
            name = f"{camera}/{1477843917481127523 + moment}.png"
            put(folder / "images" / name, encode_png(picture(motion)))
            image = pycolmap.Image()
            image.name, image.image_id, image.camera_id = name, number, key
            pose = pycolmap.Rigid3d(pycolmap.Rotation3d(turn.as_quat()), motion[:3, 3])
            model.add_image_with_trivial_frame(image, pose)
    place = folder / "rig_calibration_undistorted"
    place.mkdir()
    model.write_text(str(place))
    return folder


def bench(rig, *arguments):
    code, out, err = rig("bench", "eth3d", *map(str, arguments), "--json")
    return code, json.loads(out) if out.startswith("{") else None, err


def test_poses_are_scored_against_the_true_model(rig, tmp_path, monkeypatch):
    monkeypatch.setattr(learned, "available", lambda: False)  # SIFT places all
    scene = eth3d_scene(tmp_path / "data" / "terrains")
    with fewer_features():
        code, result, err = bench(rig, scene.parent, "--out", tmp_path / "out")
    assert (code, err) == (0, "")
    figures = result["scenes"]["terrains"]
    assert figures["placed"] == 100
    assert figures["auc_1"] > 80
    assert figures["auc_0.5"] <= figures["auc_1"] <= figures["auc_5"] <= figures["auc_10"] < 100
    assert result["published"]["COLMAP, rigs (the same)"]["auc_1"] == 45.5


@pytest.mark.parametrize("alike", [True, False])
def test_a_rig_of_which_nothing_is_placed_scores_nothing(rig, tmp_path, monkeypatch, alike):
    def refused(*_, **__):
        raise CalibrationError("No view can be placed.")

    monkeypatch.setattr("rig.benchmarks.eth3d.calibrate", refused)
    scene = eth3d_scene(tmp_path / "terrains")
    if not alike:  # a moment of which a camera has no file
        next((scene / "images" / RIG[0]).iterdir()).unlink()
    code, result, _ = bench(rig, scene, "--out", tmp_path / "out")
    assert code == 0
    assert result["mean"] == {"placed": 0.0} | dict.fromkeys(
        ("auc_0.5", "auc_1", "auc_5", "auc_10"), pytest.approx(0)
    )
    cameras = Session.open(tmp_path / "out" / "terrains" / "session").record.cameras
    assert len(cameras) == 2
    assert (cameras[0].rig == cameras[1].rig is not None) == alike


def test_a_benchmark_that_was_stopped_after_the_import_goes_on(rig, tmp_path, monkeypatch):
    steps = [KeyboardInterrupt(), CalibrationError("No view can be placed.")]

    def stopped(*_, **__):
        raise steps.pop(0)

    monkeypatch.setattr("rig.benchmarks.eth3d.calibrate", stopped)
    scene = eth3d_scene(tmp_path / "terrains")
    for folder in (scene / "images", scene / "images" / RIG[0]):
        (folder / ".DS_Store").write_bytes(b"Bud1")
    assert bench(rig, scene, "--out", tmp_path / "out")[0] == 130
    code, result, err = bench(rig, scene, "--out", tmp_path / "out")
    assert (code, err, result["mean"]["placed"]) == (0, "", 0.0)
    cameras = Session.open(tmp_path / "out" / "terrains" / "session").record.cameras
    assert cameras[0].rig == cameras[1].rig is not None

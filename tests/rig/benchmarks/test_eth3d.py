"""`rig bench eth3d` on a painted room, in the layout of ETH3D's rigs."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial.transform import Rotation

from calib.data import learned
from imaging.errors import CalibrationError
from imaging.files.colmap import pycolmap
from imaging.files.photo import encode_png
from imaging.session.session import Session
from tests.conftest import fewer_features
from tests.rig.benchmarks.painted_wall import put

WIDTH, HEIGHT, FOCAL = 320, 240, 260.0
RIG = ("images_rig_cam4_undistorted", "images_rig_cam5_undistorted")
rng = np.random.default_rng(6)


def painted() -> np.ndarray:
    """Tiles of random greys, 0..255, in two sizes one over the other."""
    fine, coarse = (
        np.kron(rng.integers(0, 256, (600 // size,) * 2), np.ones((size, size))) for size in (6, 15)
    )
    return np.asarray(gaussian_filter(np.where(coarse > 160, coarse, fine), 0.8))


PAINT = [painted(), painted()]
FRAMES = [([0.35 * n, 0.1 * (n % 2), 0.12 * n], [0, -4 * n, n]) for n in range(4)]


def picture(motion: np.ndarray) -> np.ndarray:
    """Pixels of a wall 5 m ahead, and of a floor 1.2 m below, by their rays."""
    u, v = np.meshgrid(np.arange(WIDTH) + 0.5 - WIDTH / 2, np.arange(HEIGHT) + 0.5 - HEIGHT / 2)
    rays = np.stack([u / FOCAL, v / FOCAL, np.ones_like(u)], -1) @ motion[:3, :3]
    centre = -motion[:3, :3].T @ motion[:3, 3]
    with np.errstate(divide="ignore"):
        wall, floor = (5 - centre[2]) / rays[..., 2], (1.2 - centre[1]) / rays[..., 1]
    on_floor = (floor > 0) & (floor < wall)
    hit = centre + rays * np.where(on_floor, floor, wall)[..., None]
    across = np.where(on_floor, hit[..., 2], hit[..., 1])
    places = np.stack([40 * across + 250, 40 * hit[..., 0] + 200])
    sides = [map_coordinates(paint, places, order=1, mode="wrap") for paint in PAINT]
    return np.rint(np.where(on_floor, sides[1], sides[0])).astype(np.uint8)


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

    monkeypatch.setattr("calib.calibrate.calibrate", refused)
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

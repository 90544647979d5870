"""Darks, flats and a board before the simulated rig, against closed forms and OpenCV's own detector."""

import json
from datetime import UTC, datetime
from pathlib import Path

import cv2
import numpy as np
import pytest

from drivers.sim.camera.lens import project
from drivers.sim.camera.sensor import SimulatedSensor
from drivers.sim.rigs import SimulatedRig, simulate
from drivers.sim.scene.subjects import LIGHT
from drivers.sim.truth import write_truth
from imaging.choices import Subject
from imaging.errors import InputError
from imaging.optics.exposure import Exposure
from imaging.optics.pose import Pose
from imaging.sensor.cfa import bilinear
from imaging.sensor.mosaic import RawMosaic
from imaging.session.records import SessionRecord, ShotRecord
from imaging.session.session import Session
from tests.drivers.shots import raw_shot

MIDDLE = Exposure(time=1 / 60, f_number=4.0, iso=100.0)


def shoot(rig: SimulatedRig, camera: int, frame: int, exposure: Exposure = MIDDLE) -> RawMosaic:
    rig.move_to(frame)
    return raw_shot(rig.cameras[camera], exposure)


def test_the_scene_is_the_same_whatever_was_shown_before() -> None:
    plain, varied = simulate("toy"), simulate("toy")
    expected = shoot(plain, 1, 2).pixels
    kinds: tuple[Subject, ...] = ("dark", "flat", "board")
    for kind in kinds:
        varied.show(kind)
        assert not np.array_equal(shoot(varied, 1, 2).pixels, expected)
    varied.show("scene")
    assert np.array_equal(shoot(varied, 1, 2).pixels, expected)


def test_frames_of_darks_flats_and_boards_have_any_number() -> None:
    rig = simulate("toy")
    kinds: tuple[Subject, ...] = ("dark", "flat", "board")
    for kind in kinds:
        rig.show(kind)
        rig.move_to(1000)
        with pytest.raises(InputError, match="0 or more"):
            rig.move_to(-1)
    rig.show("scene")
    with pytest.raises(InputError, match="0 to 2"):
        rig.move_to(1000)


def test_a_dark_holds_black_and_a_flat_the_fall_of_light() -> None:
    rig = simulate("toy", width=128, height=96)
    body = rig.bodies[1]
    rig.show("dark")
    assert abs(float(shoot(rig, 1, 7).signal().mean())) < 1e-4
    rig.show("flat")
    flat = shoot(rig, 1, 8)
    light = np.full((96, 128, 3), LIGHT) @ body.optics.camera_from_rec709.T
    expected = light * (body.optics.gain * body.optics.falloff() / 64 / 16)[..., None]
    channels = flat.cfa.channels(96, 128)
    ratio = flat.signal() / np.take_along_axis(expected, channels[..., None], 2)[..., 0]
    for rows in range(0, 96, 32):
        for columns in range(0, 128, 32):
            assert ratio[rows : rows + 32, columns : columns + 32].mean() == pytest.approx(1.0, abs=0.004)


def test_the_times_of_a_camera_take_a_flat_from_dark_to_white() -> None:
    rig = simulate("toy")
    rig.show("flat")
    assert shoot(rig, 0, 0, MIDDLE.with_time(1 / 8000)).signal().mean() < 0.01
    assert 0.1 < shoot(rig, 0, 0).signal().mean() < 0.3
    assert shoot(rig, 0, 0, MIDDLE.with_time(0.5)).saturated().all()


@pytest.fixture(scope="module")
def demo() -> SimulatedRig:
    rig = simulate("demo", samples=2)
    rig.show("board")
    return rig


def corners(demo: SimulatedRig, camera: int, frame: int) -> tuple[np.ndarray, np.ndarray]:
    """Corners that OpenCV finds, as true pixels [N, 2] and found pixels [N, 2]."""
    shot = shoot(demo, camera, frame)
    grey = bilinear(shot.signal(), shot.cfa)[0][..., 1]
    # Twice as large, as the detector wants some pixels for every cell of a marker.
    large = cv2.resize(np.clip(grey * 4, 0, 1) ** 0.45, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
    picture = np.rint(255 * np.clip(large, 0, 1)).astype(np.uint8)
    board = demo.board
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
    sought = cv2.aruco.CharucoBoard((board.columns, board.rows), board.square, board.marker, dictionary)
    detected, numbers, _, _ = cv2.aruco.CharucoDetector(sought).detectBoard(picture)
    if numbers is None:
        return np.empty((0, 2)), np.empty((0, 2))
    points = sought.getChessboardCorners()[numbers.ravel()].astype(float)
    pose = demo.cam_from_world(camera, frame, "board") @ np.linalg.inv(demo.board_from_world(frame))
    true = project(demo.mounts[camera].optics.lens, points @ pose[:3, :3].T + pose[:3, 3])
    return true, (detected.reshape(-1, 2) + 0.5) / 2


def test_the_board_is_where_the_truth_says(demo: SimulatedRig) -> None:
    errors, counts = [], np.zeros((5, 4), int)
    for frame in range(5):
        for camera in range(4):
            true, detected = corners(demo, camera, frame)
            errors.append(detected - true)
            counts[frame, camera] = len(true)
    together = np.concatenate(errors)
    assert len(together) > 200
    assert np.median(np.abs(together)) < 0.2
    assert np.all(np.abs(together.mean(axis=0)) < 0.05)
    assert np.sum((counts > 0).sum(axis=1) >= 2) >= 4, "several cameras see most boards"
    assert np.sum((counts > 0) & (counts < 24)) > 4, "and some of them only in part"


def test_the_board_tilts_and_comes_near(demo: SimulatedRig) -> None:
    tilts, depths = [], []
    for frame in range(200):
        pose = demo.cam_from_world(0, frame, "board") @ np.linalg.inv(demo.board_from_world(frame))
        np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-12)
        assert np.linalg.det(pose[:3, :3]) > 0
        middle = pose[:3, :3] @ (3.5 * 0.15, 2.5 * 0.15, 0.0) + pose[:3, 3]
        tilts.append(np.degrees(np.arccos(pose[:3, 2] @ middle / np.linalg.norm(middle))))
        depths.append(middle[2])
    # The line of sight of one camera differs by some degrees from that of the middle of all.
    assert np.max(tilts) < 60
    assert np.percentile(tilts, 90) > 30
    assert np.min(depths) < 1.1
    assert np.max(depths) > 1.7


def test_the_truth_tells_which_frames_showed_what(tmp_path: Path) -> None:
    rig = simulate("toy", sensor={"dead_share": 1e-3, "hot_share": 1e-3, "ceiling": 3700})
    session = Session.create(
        tmp_path,
        SessionRecord(
            name="mixed", created=datetime.now(UTC), origin="sim:toy", seed=0, cameras=rig.records()
        ),
    )
    frames: dict[Subject, tuple[int, ...]] = {"scene": (0, 2), "dark": (3, 4), "flat": (5,), "board": (6, 7)}
    for kind, numbers in frames.items():
        for frame in numbers:
            for camera in ("cam0", "cam1"):
                session.append_shot(
                    ShotRecord(
                        kind=kind,
                        plan=kind,
                        camera=camera,
                        frame=frame,
                        step=0,
                        file=f"raw/{frame:04d}/{camera}_0.dng",
                        sha256="0" * 64,
                        reported=MIDDLE,
                        width=64,
                        height=48,
                    )
                )
    write_truth(rig, tmp_path)
    truth = json.loads((tmp_path / "truth" / "truth.json").read_text())
    assert [entry["frame"] for entry in truth["frames"]] == [0, 2]
    assert sorted(path.name for path in (tmp_path / "truth").iterdir() if path.is_dir()) == ["0000", "0002"]
    assert truth["dark"]["frames"] == [3, 4]
    assert truth["flat"] == {"frames": [5], "radiance": LIGHT}
    assert [entry["frame"] for entry in truth["board"]["frames"]] == [6, 7]
    held = Pose.model_validate(truth["board"]["frames"][1]["board_from_world"]).matrix()
    np.testing.assert_allclose(held, rig.board_from_world(7), atol=1e-12)
    assert truth["board"]["square"] == rig.board.square
    assert len(truth["exposures"]) == 14
    camera = truth["cameras"]["cam1"]
    assert camera["ceiling"] == 3700
    sensor = SimulatedSensor(rig.bodies[1].sensor, 64, 48, 0, rig.bodies[1].serial, 0)
    assert {(d["x"], d["y"]) for d in camera["defects"] if d["kind"] == "dead"} == {
        (int(x), int(y)) for y, x in zip(*np.nonzero(sensor.dead), strict=True)
    }
    rig.show("flat")
    assert shoot(rig, 1, 9, MIDDLE.with_time(0.5)).pixels.max() == 3700

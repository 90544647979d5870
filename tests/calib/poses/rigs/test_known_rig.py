"""Lenses and places by a board or a ruler stay, and give the scene its scale."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from calib import evidence
from calib.boards.measure import MeasuredBoard
from calib.calibrate import calibrate
from calib.poses.rigs.known_rig import KnownRig, tie_rigs
from calib.view_images import ViewSummary
from imaging.arrays import Array
from imaging.files import store
from imaging.files.colmap import pycolmap
from imaging.optics.lens import Lens
from imaging.optics.pose import Pose
from imaging.progress import unreported
from imaging.session.calibration import CalibrationRecord, LensError, PoseError
from imaging.session.calibration_evidence import BoardEvidence
from imaging.session.records import Board
from imaging.session.view_id import ViewId
from tests.calib.conftest import even_light

FRAMES = 2


@pytest.fixture
def short(own_arm: Path, arm_looks: dict[ViewId, ViewSummary], monkeypatch: pytest.MonkeyPatch) -> Path:
    """The first frames of the arm, not calibrated yet, but for the features of its pictures."""
    monkeypatch.setattr("calib.view_images.summarise", lambda session, view, *rest: arm_looks[view.id])
    shutil.rmtree(own_arm / "calibration")
    shots = store.read_lines(own_arm / "shots.jsonl")
    (own_arm / "shots.jsonl").unlink()
    for shot in shots:
        if shot["frame"] < FRAMES:
            store.append_line(own_arm / "shots.jsonl", shot)
    return own_arm


def truth_of(session: Path) -> dict[str, dict[str, object]]:
    cameras: dict[str, dict[str, object]] = json.loads((session / "truth" / "truth.json").read_text())[
        "cameras"
    ]
    return cameras


def mounted(camera: dict[str, object]) -> Array:
    return Pose.model_validate(camera["cam_from_rig"]).matrix()


def centre(motion: Array) -> Array:
    return np.asarray(-motion[:3, :3].T @ motion[:3, 3])


def baselines(record: CalibrationRecord) -> dict[str, float]:
    """Distances of the cameras from the first, in every frame the same."""
    poses = {view.id: view.cam_from_world.matrix() for view in record.views}
    means: dict[str, float] = {}
    for name in ("cam1", "cam2", "cam3"):
        every = [
            float(np.linalg.norm(centre(poses[ViewId(frame, name)]) - centre(poses[ViewId(frame, "cam0")])))
            for frame in range(FRAMES)
        ]
        means[name] = float(np.mean(every))
        assert np.ptp(every) < 1e-9
    return means


def test_measured_positions_give_the_scale(short: Path) -> None:
    truth = truth_of(short)
    identity = store.read_json(short / "session.json")
    for camera in identity["cameras"]:
        if camera["name"] != "cam2":  # two of them would do
            camera["position"] = centre(mounted(truth[camera["name"]])).tolist()
    store.write_json(short / "session.json", identity)
    with even_light():
        record = calibrate(short, on_progress=unreported)
    assert record.unit == "m"
    ratios = [
        distance / float(np.linalg.norm(centre(mounted(truth[name])) - centre(mounted(truth["cam0"]))))
        for name, distance in baselines(record).items()
    ]
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.005)
    assert np.ptp(ratios) < 0.01


def test_what_a_board_knows_well_stays_as_it_is(short: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    truth = truth_of(short)
    small = LensError(fx=0.01, fy=0.01, cx=0.01, cy=0.01, k1=0, k2=0, p1=0, p2=0, projection=((0.01,),))
    poses = {name: Pose.model_validate(camera["cam_from_rig"]) for name, camera in truth.items()}
    board = MeasuredBoard(
        lenses={name: Lens.model_validate(camera["lens"]) for name, camera in truth.items()},
        lens_errors=dict.fromkeys(truth, small),
        cam_from_rig=poses,
        rig_errors=dict.fromkeys(truth, PoseError(rotation=0.02, translation=1e-4)),
        evidence=BoardEvidence(
            board=Board(columns=7, rows=5, square=0.1, marker=0.08),
            printed="",
            frames=9,
            views=9,
            corners=99,
            rms_px=0.1,
        ),
        rungs=(),
        sure_lenses=frozenset(truth),
        sure_rig=True,
    )
    monkeypatch.setattr(evidence, "measure_board", lambda *args: board)
    with even_light():
        record = calibrate(short, on_progress=unreported)
    assert record.unit == "m"
    assert record.board == board.evidence
    reference = record.camera("cam0")
    for camera in record.cameras:
        assert camera.lens == board.lenses[camera.name]
        assert camera.lens_error == small
        assert camera.cam_from_rig is not None
        assert reference.cam_from_rig is not None
        relative = camera.cam_from_rig.matrix() @ np.linalg.inv(reference.cam_from_rig.matrix())
        true = mounted(truth[camera.name]) @ np.linalg.inv(mounted(truth["cam0"]))
        np.testing.assert_allclose(relative, true, atol=1e-9)
    for view in record.views:
        assert view.error is not None
        assert 0.02 < view.error.rotation < 0.1  # the rig's own error is part of it
    reasons = {rung.name: rung.reason for rung in record.rungs}
    assert "a board gave" in reasons["rig_constraint"]
    assert "a board gave" in reasons["lens_terms"]
    assert record.reprojection_px is not None
    assert record.reprojection_px < 0.3


def test_a_camera_of_a_rig_that_the_board_did_not_show_stays_free() -> None:
    database, model = pycolmap.Database.open(":memory:"), pycolmap.Reconstruction()
    for name in "ABC":
        camera = pycolmap.Camera.create_from_model_name(0, "SIMPLE_RADIAL", 1000, 1200, 800)
        camera.camera_id = database.write_camera(camera)
        rig = pycolmap.Rig()
        rig.add_ref_sensor(pycolmap.sensor_t(pycolmap.SensorType.CAMERA, camera.camera_id))
        rig = database.read_rig(database.write_rig(rig))
        model.add_camera(camera)
        model.add_rig(rig)
        for number in range(FRAMES):
            image = pycolmap.Image()
            image.name, image.camera_id = ViewId(number, name).image_name, camera.camera_id
            image = database.read_image(database.write_image(image))
            frame = pycolmap.Frame(rig_id=rig.rig_id)
            frame.add_data_id(image.data_id)
            frame.frame_id = image.frame_id = database.write_frame(frame)
            frame.rig_from_world = pycolmap.Rigid3d(pycolmap.Rotation3d(), [-number, -"ABC".index(name), 0])
            model.add_frame(frame)
            model.add_image(image)
            model.register_frame(frame.frame_id)
    board = {
        name: Pose(quaternion=(1, 0, 0, 0), translation=(0, -place, 0)) for place, name in enumerate("AB")
    }
    rung = tie_rigs(database, model, [list("ABC")], KnownRig(cam_from_rig=board))
    assert rung.taken
    tied: dict[int, set[str]] = {}
    for image in model.images.values():
        tied.setdefault(image.frame.rig_id, set()).add(ViewId.of_image(image.name).camera)
    assert sorted(map(sorted, tied.values())) == [["A", "B"], ["C"]]

"""A simulated session against its truth."""

import json
import shutil
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from calib.calibrate import calibrate
from calib.poses import sfm
from imaging.colour.spaces import REC709_FROM_XYZ
from imaging.errors import InputError
from imaging.files import store
from imaging.files.colmap import pycolmap, read_points
from imaging.optics.exposure import Exposure
from imaging.optics.pose import Pose
from imaging.progress import unreported
from imaging.sensor.cfa import Cfa
from imaging.sensor.mosaic import RawMosaic, as_matrix
from imaging.sensor.noise import SensorNoise
from imaging.session.calibration import (
    CalibrationRecord,
    CameraCalibration,
    Response,
    is_stale,
    read_calibration,
)
from imaging.session.records import Rung
from imaging.session.view_id import ViewId
from recon.measure.truth import calibration_errors
from tests.calib.conftest import make_session

COLOUR_MATRIX = np.array([[0.5, 0.2, 0.05], [0.15, 0.75, 0.1], [0.05, 0.2, 0.55]])
TRUE_POSE_DEG, TRUE_POSE_RELATIVE = 0.1, 0.01


def truth_of(session: Path) -> dict:
    return json.loads((session / "truth" / "truth.json").read_text())


def test_poses_and_exposures_are_those_of_the_simulator(arm: Path) -> None:
    record = read_calibration(arm)
    assert len(record.views) == 12
    assert record.unregistered == ()
    errors = calibration_errors(arm, record)
    assert errors["pose_rotation_deg"] < TRUE_POSE_DEG
    assert errors["pose_rotation_deg_max"] < 2 * TRUE_POSE_DEG
    assert errors["pose_translation_relative"] < TRUE_POSE_RELATIVE
    assert errors["pose_translation_relative_max"] < TRUE_POSE_RELATIVE
    assert errors["exposure_ratio_error_max"] < 2e-3
    assert record.reprojection_px is not None
    assert record.reprojection_px < 0.3


def test_lens_falloff_and_gain_are_those_of_the_simulator(arm: Path) -> None:
    record, truth = read_calibration(arm), truth_of(arm)["cameras"]
    radius = np.linspace(0.0, 0.9, 10)[:, None] ** np.array([2, 4, 6])
    for camera in record.cameras:
        lens, true = camera.lens, truth[camera.name]
        assert lens is not None
        assert (lens.width, lens.height) == (320, 240)
        assert lens.fx == pytest.approx(true["lens"]["fx"], rel=0.01)
        assert lens.k1 == pytest.approx(true["lens"]["k1"], abs=0.02)
        fall = 1 + radius @ np.array(camera.vignetting)
        np.testing.assert_allclose(fall, 1 + radius @ np.array(true["vignetting"]), atol=0.04)
        assert camera.noise is not None
        assert camera.noise.gain == pytest.approx(true["noise"]["gain"], rel=0.03)
        np.testing.assert_allclose(camera.camera_from_rec709, true["camera_from_rec709"], atol=2e-3)
    gains = np.log([[camera.gain, truth[camera.name]["gain"]] for camera in record.cameras])
    gains -= gains.mean(0)
    np.testing.assert_allclose(gains[:, 0], gains[:, 1], atol=0.015)


def test_raw_is_found_linear_and_says_by_how_much(arm: Path) -> None:
    record = read_calibration(arm)
    for camera in record.cameras:
        assert camera.response.kind == "linear"
        assert "straight line" in camera.response.evidence
    rungs = {rung.name: rung for rung in record.rungs}
    assert not rungs["response_curve"].taken
    assert rungs["response_curve"].gain is not None
    assert rungs["response_curve"].gain < 1.0
    assert "raw_curve" not in rungs
    assert rungs["rig_constraint"].taken
    assert rungs["vignetting"].taken
    assert rungs["exposure_ratios"].taken
    assert not rungs["exposure_per_shot"].taken


def test_cameras_of_the_rig_keep_one_place_in_it(arm: Path) -> None:
    record = read_calibration(arm)
    poses = {v.id: v.cam_from_world.matrix() for v in record.views}
    for frame in range(3):
        rig = [
            np.linalg.inv(camera.cam_from_rig.matrix()) @ poses[ViewId(frame, camera.name)]
            for camera in record.cameras
            if camera.cam_from_rig is not None
        ]
        assert len(rig) == 4
        np.testing.assert_allclose(rig, np.broadcast_to(rig[0], (4, 4, 4)), atol=1e-6)


def test_the_colmap_model_names_the_previews_and_projects_onto_them(arm: Path) -> None:
    record = read_calibration(arm)
    folder = arm / "calibration"
    model = pycolmap.Reconstruction(str(folder / "colmap"))
    names = {image.name for image in model.images.values()}
    assert names == {v.id.image_name for v in record.views}
    assert all((folder / "previews" / name).is_file() for name in names)
    points = read_points(folder / "colmap")
    assert len(points.xyz) == record.points > 500
    assert points.views.min() >= 2
    # The record's own pose and lens put the model's points where the model's features are.
    view = record.views[0]
    lens = record.camera(view.camera).lens
    assert lens is not None
    image = model.find_image_with_name(view.id.image_name)
    with_points = [point for point in image.points2D if point.has_point3D()]
    world = np.array([model.points3D[point.point3D_id].xyz for point in with_points])
    motion = view.cam_from_world.matrix()
    x, y, z = (world @ motion[:3, :3].T + motion[:3, 3]).T
    square = (x**2 + y**2) / z**2
    radial = 1 + square * (lens.k1 + lens.k2 * square)
    pixel = np.stack([lens.fx * radial * x / z + lens.cx, lens.fy * radial * y / z + lens.cy], 1)
    miss = np.linalg.norm(pixel - np.array([np.ravel(point.xy) for point in with_points]), axis=1)
    assert len(with_points) == view.points
    assert np.median(miss) < 0.5


def test_new_shots_make_it_stale(own_arm: Path) -> None:
    record = read_calibration(own_arm)
    assert not is_stale(own_arm, record)
    shots = own_arm / "shots.jsonl"
    shots.write_bytes(shots.read_bytes()[: -len(shots.read_bytes().splitlines(keepends=True)[-1])])
    assert is_stale(own_arm, record)
    with pytest.raises(InputError, match="without --only"):
        calibrate(own_arm, only="response", on_progress=unreported)


@pytest.mark.parametrize("part", ["response", "sensor", "colour"])
def test_one_part_is_measured_again_and_the_rest_stays(own_arm: Path, part: str) -> None:
    before = read_calibration(own_arm)
    spoiled = before.model_copy(
        update={
            "cameras": tuple(
                camera.model_copy(
                    update={
                        "noise": None,
                        "camera_from_rec709": None,
                        "response": camera.response.model_copy(update={"evidence": "spoiled"}),
                    }
                )
                for camera in before.cameras
            )
        }
    )
    path = own_arm / "calibration" / "calibration.json"
    store.write_json(path, spoiled.model_dump(mode="json"))
    after = calibrate(own_arm, only=part, on_progress=unreported)
    assert after == read_calibration(own_arm)
    assert after.views == before.views
    for then, now in zip(before.cameras, after.cameras, strict=True):
        assert now.lens == then.lens
        assert (now.response == then.response) == (part == "response")
        assert (now.noise == then.noise) == (part == "sensor")
        assert (now.camera_from_rec709 == then.camera_from_rec709) == (part == "colour")
    assert sorted(r.name for r in after.rungs) == sorted(r.name for r in before.rungs)


def test_beside_poses_that_were_given_the_files_tell_noise_and_colours(tmp_path: Path) -> None:
    """Nobody looked at what the files say of the camera; what a calibration did judge stays as it is."""
    rng, noise = np.random.default_rng(0), SensorNoise(gain=0.4, read_noise=3.0)
    stated = as_matrix(COLOUR_MATRIX @ REC709_FROM_XYZ)
    shots = [
        (
            RawMosaic(
                rng.poisson(400 * time, (48, 64)).astype(np.uint16), Cfa.RGGB, ((0.0,),), 4095,
                camera_from_xyz=stated, noise_profile=noise.profile(0.0, 4095.0),
            ),
            Exposure(time=time),
        )
        for time in (1.0, 4.0)
    ]  # fmt: skip
    made = make_session(tmp_path / "S", [shots])
    camera = CameraCalibration(name="cam", serial="cam", response=Response(kind="linear", evidence="RAW"))
    given = Rung(name="poses", taken=True, reason="given")
    record = CalibrationRecord(
        created=datetime.now(UTC), versions={}, shots_sha256=store.sha256(made / "shots.jsonl"),
        cameras=(camera,), views=(), exposure_scale={}, rungs=(given,),
    )  # fmt: skip
    path = made / "calibration" / "calibration.json"
    store.write_json(path, record.model_dump(mode="json"))
    after = calibrate(made, only="response", on_progress=unreported)
    (measured,) = after.cameras
    np.testing.assert_allclose(measured.camera_from_rec709, COLOUR_MATRIX, atol=1e-3)
    assert measured.noise is not None
    assert measured.noise.gain == pytest.approx(0.4, rel=1e-3)
    rungs = {rung.name: rung for rung in after.rungs}
    assert "files of 1 of 1 cameras" in rungs["camera_colour"].reason
    assert rungs["poses"] == given
    judged = Rung(name="camera_colour", taken=False, reason="judged")
    spoiled = after.model_copy(update={"cameras": (camera,), "rungs": (given, judged)})
    store.write_json(path, spoiled.model_dump(mode="json"))
    assert calibrate(made, only="response", on_progress=unreported).cameras[0].camera_from_rec709 is None


def test_response_alone_needs_no_poses(own_arm: Path) -> None:
    shutil.rmtree(own_arm / "calibration")
    record = calibrate(own_arm, only="response", on_progress=unreported)
    assert record.views == ()
    assert record.unregistered == ()
    assert calibration_errors(own_arm, record)["exposure_ratio_error_max"] < 2e-3


def test_pose_of_a_pycolmap_motion() -> None:
    motion = pycolmap.Rigid3d(pycolmap.Rotation3d(np.array([0.1, -0.7, 0.1, 0.7])), np.array([1.0, 2.0, 3.0]))
    pose = sfm.pose_of(motion)
    assert isinstance(pose, Pose)
    np.testing.assert_allclose(pose.matrix()[:3], motion.matrix(), atol=1e-12)

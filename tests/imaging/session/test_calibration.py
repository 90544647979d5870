"""The calibration record: poses, lenses and the cameras in it."""

from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imaging.errors import InputError
from imaging.files import store
from imaging.lens import Lens
from imaging.pose import Pose
from imaging.session.calibration import CalibrationRecord, CameraCalibration, Response, read_calibration

RECORD = CalibrationRecord(
    created=datetime(2024, 5, 6),
    versions={},
    shots_sha256="00",
    cameras=(CameraCalibration(name="a", serial="A", response=Response(kind="linear", evidence="RAW")),),
    views=(),
    exposure_scale={},
)


def test_a_pose_is_the_rotation_of_its_quaternion() -> None:
    generator = np.random.default_rng(1)
    for _ in range(20):
        w, x, y, z = quaternion = generator.normal(size=4)
        pose = Pose(quaternion=tuple(quaternion), translation=(1.0, 2.0, 3.0))
        expected = Rotation.from_quat([x, y, z, w]).as_matrix()
        assert np.allclose(pose.matrix()[:3, :3], expected, atol=1e-12)
        assert pose.matrix()[:, 3].tolist() == [1.0, 2.0, 3.0, 1.0]


def test_a_resized_lens_sees_the_same_directions() -> None:
    lens = Lens(model="OPENCV", width=640, height=480, fx=500, fy=510, cx=321, cy=239, k1=0.1)
    half = lens.resized(320, 120)
    # the edges of the image stay its edges: pixel centres lie at +0.5
    for x, y in ((0.0, 0.0), (640.0, 480.0), (10.5, 20.5)):
        assert (x / 2 - half.cx) / half.fx == pytest.approx((x - lens.cx) / lens.fx)
        assert (y / 4 - half.cy) / half.fy == pytest.approx((y - lens.cy) / lens.fy)
    assert (half.k1, half.width, half.height) == (0.1, 320, 120)


def test_a_record_comes_back_and_knows_its_cameras(tmp_path: Path) -> None:
    store.write_json(tmp_path / "calibration" / "calibration.json", RECORD.model_dump(mode="json"))
    record = read_calibration(tmp_path)
    assert record == RECORD
    assert record.camera("a").serial == "A"
    with pytest.raises(InputError, match="no camera 'b'"):
        record.camera("b")


def test_no_calibration_is_said(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is not calibrated: run `rig calibrate"):
        read_calibration(tmp_path)

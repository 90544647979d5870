"""The calibration record: poses, lenses and the cameras in it."""

from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imaging.errors import InputError
from imaging.files import store
from imaging.optics.lens import Lens
from imaging.optics.pose import Pose
from imaging.session.calibration import (
    CalibrationRecord,
    CameraCalibration,
    Response,
    ViewCalibration,
    read_calibration,
)

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


@pytest.mark.parametrize("parts", [(), ("exposure",), ("white_balance",), ("exposure", "white_balance")])
def test_what_points_ask_for_against_the_files_multiplies_light_as_it_says(parts: tuple[str, ...]) -> None:
    colour = np.exp([0.1, -0.04, -0.06])
    view = ViewCalibration(
        camera="a",
        frame=0,
        cam_from_world=Pose(quaternion=(1.0, 0.0, 0.0, 0.0), translation=(0.0, 0.0, 0.0)),
        points=9,
        exposure=1.5,
        white_balance=(0.9, 1.0, 1.2),
        exposure_asked=1.3,
        white_balance_asked=tuple(colour),
    )
    overruled = view.overruled(parts)
    factor = (1.3 if "exposure" in parts else 1.0) * (colour if "white_balance" in parts else np.ones(3))
    light = overruled.exposure * np.array(overruled.white_balance)
    assert np.allclose(light, 1.5 * np.array([0.9, 1.0, 1.2]) * factor)
    assert overruled.white_balance[1] == 1.0
    assert (overruled.exposure_asked is None) == ("exposure" in parts)
    assert (overruled.white_balance_asked is None) == ("white_balance" in parts)

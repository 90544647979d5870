"""Distances between the views of a panorama, and how far they move what is seen."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.exports.panorama.standpoint import parallax_of
from imaging.files.colmap import pycolmap
from imaging.optics.pose import Pose
from imaging.session.calibration import ViewCalibration

CENTRE = np.array([1.2, -0.7, 3.1])


def views(digits: int, *, aside: float = 0.0) -> list[ViewCalibration]:
    """Views all round from one place, by poses of so many digits; aside: of the first view."""
    made = []
    for frame in range(12):
        turn = Rotation.from_euler("y", 30 * frame, degrees=True)
        place = np.add(CENTRE, (aside, 0, 0)) if frame == 0 else CENTRE
        w, x, y, z = np.round(turn.as_quat(scalar_first=True), digits)
        a, b, c = np.round(-turn.apply(place), digits)
        pose = Pose(quaternion=(w, x, y, z), translation=(a, b, c))
        made.append(ViewCalibration(camera="cam", frame=frame, cam_from_world=pose, points=0))
    return made


def test_poses_of_few_digits_are_one_place_but_for_a_known_distance(tmp_path: Path) -> None:
    assert parallax_of(tmp_path, views(15))[1] == 0.0
    apart, degrees = parallax_of(tmp_path, views(6))
    assert apart < 1e-5
    assert degrees is None


def test_parallax_is_of_the_median_point(tmp_path: Path) -> None:
    apart, degrees = parallax_of(tmp_path, views(15, aside=0.12))
    assert (apart, degrees) == (pytest.approx(2 * 0.11), None)
    model = pycolmap.Reconstruction()
    for distance in (1.0, 4.0, 500.0):
        model.add_point3D(np.add(CENTRE, (0.01, 0, distance)), pycolmap.Track(), np.zeros(3, np.uint8))
    folder = tmp_path / "calibration" / "colmap"
    folder.mkdir(parents=True)
    model.write(str(folder))
    assert parallax_of(tmp_path, views(15, aside=0.12))[1] == pytest.approx(np.degrees(0.22 / 4), rel=1e-3)
    assert parallax_of(tmp_path, views(6))[1] == pytest.approx(0, abs=1e-4)

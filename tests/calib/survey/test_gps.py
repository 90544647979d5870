"""A simulated scene placed by where its photographs say that they were taken."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from bench.calibration.pose_error import true_poses
from calib.data.views import scene_views
from calib.poses.sfm import SceneModel, centres, transformed
from calib.survey.gps import GpsFit, fit_gps, place_by_gps, positions_of
from calib.survey.locate import _expected
from calib.survey.placing import Expected
from imaging.files.colmap import pycolmap
from imaging.files.photo import encode_jpeg
from imaging.files.tiff.exif import decode_exif, encode_exif, from_names
from imaging.optics.exposure import Exposure
from imaging.sensor.mosaic import FrameMetadata, GpsPosition
from imaging.session.session import Session
from imaging.session.view_id import ViewId
from tests.calib.conftest import make_session

ORIGIN = (48.5, -11.25, 500.0)


def positions(session: Path, error: float, size: float, seed: int = 0) -> dict[ViewId, GpsPosition]:
    """Positions of the true cameras with a normal error, m, in a scaled scene."""
    rng = np.random.default_rng(seed)
    truth = true_poses(session)
    metres = size * np.array([-pose[:3, :3].T @ pose[:3, 3] for pose in truth.values()])
    transform = pycolmap.GPSTransform(pycolmap.GPSTransformEllipsoid.WGS84)
    places = transform.enu_to_ellipsoid(metres + rng.normal(0, error, metres.shape), *ORIGIN)
    return {view: GpsPosition(*place) for view, place in zip(truth, places.tolist(), strict=True)}


@pytest.mark.parametrize(("error", "size"), [(0.005, 1.0), (0.5, 100.0)])
def test_the_scene_has_its_true_size(
    arm: Path, model_of: Callable[[Path], SceneModel], error: float, size: float
) -> None:
    for seed in range(3):
        fit = fit_gps(model_of(arm), positions(arm, error, size, seed))
        assert isinstance(fit, GpsFit)
        model, coordinates, rung = place_by_gps(model_of(arm), fit)
        assert rung.taken
        assert coordinates is not None
        assert model.metric
        truth = true_poses(arm)
        views = sorted(model.poses)
        true = size * np.array([-truth[view][:3, :3].T @ truth[view][:3, 3] for view in views])
        here = centres([model.poses[view] for view in views])
        assert coordinates.scale_error is not None
        ratio = np.linalg.norm(here[0] - here[-1]) / np.linalg.norm(true[0] - true[-1])
        assert abs(ratio - 1) < 4 * coordinates.scale_error + 0.003
        assert coordinates.scale_error < 0.05
        turns = [
            np.degrees(
                np.arccos(np.clip((np.trace(pose.matrix()[:3, :3] @ truth[view][:3, :3].T) - 1) / 2, -1, 1))
            )
            for view, pose in model.poses.items()
        ]
        assert max(turns) < 4 * coordinates.rotation_error + 0.3
        assert coordinates.position_error >= coordinates.rms


def test_a_known_scale_is_kept(arm: Path, model_of: Callable[[Path], SceneModel]) -> None:
    """Keep a board that was measured 3 % too large by its statement."""
    fit = fit_gps(model_of(arm), positions(arm, 0.005, 1.0))
    assert isinstance(fit, GpsFit)
    size = 1.03 * fit.similarity.scale
    known = transformed(model_of(arm), pycolmap.Sim3d(size, pycolmap.Rotation3d(), np.zeros(3)))
    before = centres([known.poses[view] for view in sorted(known.poses)])
    model, coordinates, _ = place_by_gps(known, fit_gps(known, positions(arm, 0.005, 1.0)))
    after = centres([model.poses[view] for view in sorted(model.poses)])
    assert coordinates is not None
    assert coordinates.scale_error is None
    assert np.linalg.norm(after[0] - after[-1]) == pytest.approx(np.linalg.norm(before[0] - before[-1]))
    assert _expected(known, fit) == Expected(1.0, "the board or the positions of the rig's cameras", 0.05)
    by_gps = _expected(model_of(arm), fit)
    assert by_gps is not None
    assert by_gps.scale == pytest.approx(float(fit.similarity.scale))


def test_receivers_that_scatter_more_than_the_cameras_stand_apart_place_nothing(
    arm: Path, model_of: Callable[[Path], SceneModel]
) -> None:
    model, coordinates, rung = place_by_gps(model_of(arm), fit_gps(model_of(arm), positions(arm, 4.0, 1.0)))
    assert coordinates is None
    assert not rung.taken
    assert not model.metric


def test_one_position_for_all_tells_nothing(arm: Path, model_of: Callable[[Path], SceneModel]) -> None:
    same = dict.fromkeys(true_poses(arm), GpsPosition(*ORIGIN))
    fit = fit_gps(model_of(arm), same)
    assert isinstance(fit, str)
    assert "1 positions" in fit


def test_positions_stand_in_the_files(tmp_path: Path) -> None:
    picture = np.full((40, 60, 3), 90, np.uint8)
    folder = make_session(tmp_path / "session", [[(picture, Exposure(time=0.1))]] * 3)
    session = Session.open(folder)
    stated = [GpsPosition(*ORIGIN, 3.0), GpsPosition(-33.0, 151.0, None)]
    for shot, position in zip(session.shots("scene"), stated, strict=False):
        session.file(shot).write_bytes(encode_jpeg(picture, 95, FrameMetadata(position=position)))
    assert positions_of(session, scene_views(session)) == {ViewId(0, "cam"): stated[0]}


@pytest.mark.parametrize(
    "position", [GpsPosition(48.1234567, -11.7654321, -12.5, 4.0), GpsPosition(-33.5, 151.25, 8848.0)]
)
def test_exif_keeps_positions(position: GpsPosition) -> None:
    metadata = decode_exif(encode_exif(FrameMetadata(make="Maker", position=position)))
    assert metadata.make == "Maker"
    assert metadata.position == position


def test_damaged_positions_are_none() -> None:
    block = encode_exif(FrameMetadata(make="Maker", position=GpsPosition(10.0, 20.0, 30.0)))
    metadata = decode_exif(block[:-60])
    assert metadata.make in ("Maker", "")
    for latitude, longitude in ((0.0, 0.0), (91.0, 5.0), (5.0, 181.0)):
        stated = FrameMetadata(position=GpsPosition(latitude, longitude, 0.0))
        assert decode_exif(encode_exif(stated)).position is None
    assert from_names({"GPS GPSLatitude": [1, 2], "GPS GPSLongitude": "x"}).position is None

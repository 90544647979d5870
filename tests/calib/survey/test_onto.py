"""A session placed in the coordinates of another, photographed later from elsewhere."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.calibration.pose_error import true_poses
from calib.calibrate import calibrate
from calib.data.features import Features, extract
from calib.evidence import _target
from calib.poses.sfm import SceneModel
from calib.request import CalibrationRequest
from calib.survey.onto import place_onto, read_target
from calib.survey.similarity import fit
from capture.simulated import capture_simulated
from imaging.errors import CalibrationError, InputError
from imaging.files import store
from imaging.progress import unreported
from imaging.session.calibration import read_calibration
from imaging.session.coordinates import CoordinateSystem
from imaging.session.session import Session
from imaging.session.view_id import ViewId
from tests.conftest import fewer_rays

LATER = 3
"""The frame that the arm has no shots of."""


@pytest.fixture(scope="module")
def later(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The demo's rig at its fourth position alone, not calibrated."""
    session = tmp_path_factory.mktemp("later") / "session"
    with fewer_rays():
        capture_simulated("demo", session, seed=1, frames=LATER + 1)
    shots = store.read_lines(session / "shots.jsonl")
    (session / "shots.jsonl").unlink()
    for shot in shots:
        if shot["frame"] == LATER:
            store.append_line(session / "shots.jsonl", shot)
    return session


@pytest.fixture(scope="module", autouse=True)
def found_once() -> Iterator[None]:
    """The features of the arm's twelve pictures are found once for both tests that are placed onto them."""
    features: dict[bytes, Features] = {}

    def remembered(picture: np.ndarray) -> Features:
        known = picture.tobytes()
        if known not in features:
            features[known] = extract(picture)
        return features[known]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("calib.survey.onto.extract", remembered)
        yield


def centre(motion: np.ndarray) -> np.ndarray:
    return -motion[:3, :3].T @ motion[:3, 3]


def test_views_of_both_stand_to_each_other_as_they_truly_did(
    arm: Path, later: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(arm.parent)
    record = calibrate(later, CalibrationRequest(onto=arm.name))
    monkeypatch.undo()
    coordinates, other, truth = (
        record.coordinates,
        read_calibration(arm),
        {**true_poses(arm), **true_poses(later)},
    )
    assert coordinates is not None
    assert (coordinates.source, coordinates.onto) == ("session", str(arm))
    assert record.unit == other.unit == "relative"
    assert len(record.views) == 4
    theirs = {view.id: view.cam_from_world.matrix() for view in other.views}
    ours = {view.id: view.cam_from_world.matrix() for view in record.views}
    turns = [
        np.degrees(
            Rotation.from_matrix(
                ours[a][:3, :3] @ theirs[b][:3, :3].T @ truth[b][:3, :3] @ truth[a][:3, :3].T
            ).magnitude()
        )
        for a in ours
        for b in theirs
    ]
    assert np.median(turns) < 2 * coordinates.rotation_error
    assert np.median(turns) < 0.3
    to_truth = fit(
        np.array([centre(theirs[view]) for view in theirs]),
        np.array([centre(truth[view]) for view in theirs]),
    )
    off = to_truth(np.array([centre(ours[view]) for view in ours])) - [centre(truth[view]) for view in ours]
    assert np.linalg.norm(off, axis=1).max() < 0.05  # of 3 m to the table

    again = _target(
        Session.open(later), CalibrationRequest(), read_calibration(later)
    )  # where the next calibration places it
    assert again is not None
    assert again.folder == arm
    assert _target(Session.open(later), CalibrationRequest(onto="none"), read_calibration(later)) is None


def test_sessions_that_share_nothing_are_not_placed(
    arm: Path, model_of: Callable[[Path], SceneModel], tmp_path: Path
) -> None:
    """Descriptors of noise."""
    model, rng = model_of(arm), np.random.default_rng(0)
    before = {view: pose.matrix() for view, pose in model.poses.items()}
    features = {}
    for index in model.reconstruction.reg_image_ids():
        image = model.reconstruction.image(index)
        points = np.array([np.ravel(point.xy) for point in image.points2D])[::4]
        noise = rng.integers(0, 256, (len(points), 128), np.uint8)
        features[ViewId.of_image(image.name)] = Features(points, noise)
    with pytest.raises(CalibrationError, match="share 0 scene points"):
        place_onto(model, features, read_target(arm), unreported)
    for view, pose in model.poses.items():
        np.testing.assert_array_equal(pose.matrix(), before[view])


def test_a_target_of_an_earlier_run_that_is_gone_is_said_to_be_of_one(arm: Path, tmp_path: Path) -> None:
    gone = CoordinateSystem(
        source="session", system="local", rms=0.1, scale_error=None, rotation_error=0.1, position_error=0.1,
        used=100, onto=str(tmp_path / "gone"),
    )  # fmt: skip
    session, earlier = Session.open(arm), read_calibration(arm).model_copy(update={"coordinates": gone})
    with pytest.raises(InputError, match=r"gone is not calibrated: .* an earlier run with --onto none\.$"):
        _target(session, CalibrationRequest(), earlier)
    with pytest.raises(InputError, match=r"first\.$"):
        _target(session, CalibrationRequest(onto=tmp_path / "gone"), earlier)


def test_what_nothing_can_be_placed_onto_is_one_sentence(own_arm: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is not calibrated"):
        calibrate(own_arm, CalibrationRequest(onto=tmp_path))
    with pytest.raises(InputError, match="onto itself"):
        calibrate(own_arm, CalibrationRequest(onto=own_arm))
    with pytest.raises(InputError, match="leave them"):
        calibrate(own_arm, CalibrationRequest(only="colour", onto=tmp_path))
    (own_arm / "calibration" / "colmap" / "cameras.bin").unlink()
    with pytest.raises(InputError, match="damaged"):
        read_target(own_arm)
    shots = own_arm / "shots.jsonl"
    shots.write_text("".join(shots.read_text().splitlines(keepends=True)[:-1]))
    with pytest.raises(InputError, match="not calibrated with all"):
        read_target(own_arm)

"""Steps to poses are done once, and what a stopped run did leads to the same poses to the last bit."""

import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.adjustment.place_priors import StatedPlace
from calib.data.unfinished import Unfinished
from calib.poses.pose_inputs import PoseInputs
from calib.poses.sfm import SceneModel, solve
from calib.poses.steps import Done, Steps
from imaging.files.colmap import pycolmap
from imaging.progress import Progress
from imaging.session.view_id import ViewId

from .test_sfm import GUESS, arc, features_of

STEPS = "placing views", "adjusting", "judging the lens"
FEATURES = {ViewId(frame, "cam"): features_of(*arc(6)[frame], seed=frame) for frame in range(6)}


KILLED = """
import os, signal, sys
from pathlib import Path

import calib.poses.steps
from tests.calib.poses.test_steps import solved

def killed(message, done, total):
    if (message, done) == ("placing views", 4):
        os.kill(os.getpid(), signal.SIGKILL)

calib.poses.steps.EVERY = -1.0
solved(Path(sys.argv[1]), killed)
"""


def solved(session: Path, progress: Progress) -> SceneModel:
    return solve(PoseInputs(FEATURES, progress=progress, unfinished=Unfinished(session, "q")), {"cam": GUESS})


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> SceneModel:
    return solved(tmp_path_factory.mktemp("undisturbed"), lambda *done: None)


@pytest.mark.parametrize("last", [*STEPS[1:], "measuring how sure it is"])
def test_poses_go_on_from_the_last_step_that_was_done(
    last: str, undisturbed: SceneModel, tmp_path: Path
) -> None:
    def stop(message: str, done: int, total: int) -> None:
        if message == last:
            raise KeyboardInterrupt

    again: set[str] = set()
    with pytest.raises(KeyboardInterrupt):
        solved(tmp_path, stop)
    model = solved(tmp_path, lambda message, done, total: again.add(message))
    assert again.isdisjoint(STEPS[: STEPS.index(last)] if last in STEPS else STEPS)
    assert len(model.poses) == 6
    assert model.poses == undisturbed.poses
    assert model.lenses == undisturbed.lenses
    assert model.rungs == undisturbed.rungs
    assert model.points == undisturbed.points
    assert model.errors is not None
    assert undisturbed.errors is not None
    assert model.errors.rotation == undisturbed.errors.rotation


def test_views_that_a_killed_run_placed_are_placed(
    undisturbed: SceneModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is kept meanwhile changes nothing, and views that are placed later are as near to the truth."""
    monkeypatch.setattr("calib.poses.steps.EVERY", -1.0)
    assert solved(tmp_path / "whole", lambda *done: None).poses == undisturbed.poses
    command = [sys.executable, "-c", KILLED, str(tmp_path / "killed")]
    assert subprocess.run(command, timeout=60, check=False).returncode == -signal.SIGKILL
    numbers: list[int] = []

    def placed(message: str, done: int, total: int) -> None:
        if message == "placing views":
            numbers.append(done)

    model = solved(tmp_path / "killed", placed)
    assert numbers[:4] == [0, 4, 5, 6]
    assert model.poses.keys() == undisturbed.poses.keys()
    assert model.reprojection_px < 1.05 * undisturbed.reprojection_px
    assert worst_turn(model) < max(1.5 * worst_turn(undisturbed), 0.02)


def worst_turn(model: SceneModel) -> float:
    """Largest error of the turn from the first view to another, degrees."""
    poses = [model.poses[view].matrix()[:3, :3] for view in FEATURES]
    turns = zip(poses, (rotation for rotation, _ in arc(6)), strict=True)
    errors = [pose @ poses[0].T @ (rotation @ arc(6)[0][0].T).T for pose, rotation in turns]
    return max(float(np.degrees(np.linalg.norm(Rotation.from_matrix(one).as_rotvec()))) for one in errors)


def made() -> Done:
    model = pycolmap.Reconstruction()
    model.add_camera_with_trivial_rig(
        pycolmap.Camera(model="PINHOLE", width=4, height=3, params=[0.1 + 0.2, 2, 2, 1.5], camera_id=7)
    )
    return Done((None, model), {"typical": 0.1 + 0.2, "worst": float("inf")})


def undone() -> Done:
    raise AssertionError("done a second time")


def test_a_step_is_known_by_its_place_and_by_what_it_follows_from(tmp_path: Path) -> None:
    inputs: list[object] = [{"b", "a"}, StatedPlace(np.zeros(3), np.ones(3)), GUESS]
    Steps(Unfinished(tmp_path, "q"), inputs).result(made)
    steps = Steps(Unfinished(tmp_path, "q"), inputs)
    done = steps.result(undone)
    assert done.rest == made().rest
    assert done.models[0] is None
    assert list(done.models[1].cameras[7].params) == [0.1 + 0.2, 2, 2, 1.5]
    with pytest.raises(AssertionError, match="second time"):
        steps.result(undone)
    inputs[1] = StatedPlace(np.zeros(3), np.array([1, 1, 1 + 1e-15]))
    with pytest.raises(AssertionError, match="second time"):
        Steps(Unfinished(tmp_path, "q"), inputs).result(undone)

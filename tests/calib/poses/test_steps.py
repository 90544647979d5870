"""Steps to poses are done once, and what a stopped run did leads to the same poses to the last bit."""

from pathlib import Path

import numpy as np
import pytest

from calib.adjustment.place_priors import StatedPlace
from calib.data.unfinished import Unfinished
from calib.poses.sfm import SceneModel, solve
from calib.poses.steps import Done, Steps
from imaging.files.colmap import pycolmap
from imaging.progress import Progress
from imaging.session.view_id import ViewId

from .test_sfm import GUESS, arc, features_of

STEPS = "placing views", "adjusting", "judging the lens"
FEATURES = {ViewId(frame, "cam"): features_of(*arc(6)[frame], seed=frame) for frame in range(6)}


def solved(session: Path, progress: Progress) -> SceneModel:
    return solve(FEATURES, {"cam": GUESS}, [], 1, progress, unfinished=Unfinished(session, "q"))


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

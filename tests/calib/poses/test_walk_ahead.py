"""Views taken by going ahead: no pair shows the scene from the side, and the files tell the focal length."""

import numpy as np
import pytest

from calib.data.features import Features
from calib.poses.pose_inputs import PoseInputs
from calib.poses.sfm import SceneModel, centres, solve
from imaging.errors import CalibrationError
from imaging.optics.lens import Lens
from imaging.session.view_id import ViewId

WIDTH, HEIGHT, FOCAL = 640, 480, 600.0
FILE = Lens(model="SIMPLE_RADIAL", width=WIDTH, height=HEIGHT, fx=FOCAL, fy=FOCAL, cx=320, cy=240)
STEPS, STEP = 7, 1.5
SPIN = np.radians(2.0)


def pose(step: int) -> tuple[np.ndarray, np.ndarray]:
    """Rotation and centre of a view down the street, as steady as a hand is."""
    turn = SPIN * np.sin(1.7 * step)
    c, s = np.cos(turn), np.sin(turn)
    return np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]), np.array([0.05 * np.sin(step), 0, STEP * step])


@pytest.fixture(scope="module")
def street() -> dict[ViewId, Features]:
    """View of a walk between two walls, as far as twelve metres."""
    rng = np.random.default_rng(3)
    count = 2500
    side = rng.choice([-1.0, 1.0], count)
    world = np.stack([3 * side, rng.uniform(-2, 1.5, count), rng.uniform(2, 26, count)], axis=1)
    descriptors = rng.exponential(30, (count, 128))
    views = {}
    for step in range(STEPS):
        rotation, centre = pose(step)
        x, y, z = ((world - centre) @ rotation.T).T
        u, v = FOCAL * x / z + WIDTH / 2, FOCAL * y / z + HEIGHT / 2
        inside = np.flatnonzero((z > 1) & (z < 12) & (u > 0) & (u < WIDTH) & (v > 0) & (v < HEIGHT))
        places = np.stack([u, v], axis=1)[inside] + rng.normal(0, 0.2, (len(inside), 2))
        noisy = descriptors[inside] + rng.normal(0, 2, (len(inside), 128))
        views[ViewId(step, "phone")] = Features(places, np.clip(noisy, 0, 255).astype(np.uint8))
    return views


@pytest.fixture(scope="module")
def model(street: dict[ViewId, Features]) -> SceneModel:
    return solve(PoseInputs(street, focal_known={"phone"}), {"phone": FILE})


def test_all_views_are_placed_where_they_are(model: SceneModel) -> None:
    assert len(model.poses) == STEPS
    views = sorted(model.poses)
    turns = [model.poses[view].matrix()[:3, :3] for view in views]
    for step in range(1, STEPS):
        relative = turns[step] @ turns[0].T @ (pose(step)[0] @ pose(0)[0].T).T
        assert np.degrees(np.arccos(np.clip((np.trace(relative) - 1) / 2, -1, 1))) < 0.2
    estimated = centres([model.poses[view] for view in views])
    steps = np.linalg.norm(np.diff(estimated, axis=0), axis=1)
    assert steps / steps.mean() == pytest.approx(np.ones(STEPS - 1), abs=0.03)


def test_the_lens_stays_as_the_files_say(model: SceneModel) -> None:
    (rung,) = (rung for rung in model.rungs if rung.name == "walk_ahead")
    assert rung.taken
    assert f"only 0 of {STEPS} views" in rung.reason
    assert model.lenses["phone"].fx == FOCAL
    assert model.errors is not None
    assert "phone" not in model.errors.lenses
    assert "the files gave" in next(rung.reason for rung in model.rungs if rung.name == "lens_terms")


def test_without_a_focal_length_such_views_are_refused(street: dict[ViewId, Features]) -> None:
    with pytest.raises(CalibrationError, match="give a start"):
        solve(PoseInputs(street), {"phone": FILE})

"""Turns against what a table states: the true axis and errors, and poses that follow from stated angles."""

import numpy as np
import pytest

from calib.poses.sfm import SceneModel, pose_of
from calib.turntable.angles import axis_of, with_angles
from drivers.sim.rigs import simulate
from imaging.files.colmap import pycolmap
from imaging.session.turntable import TurntableRecord
from imaging.session.view_id import ViewId

RIG = simulate("turntable", 4, cameras=2)
STATED = RIG.turntable
LOST = ViewId(7, "cam1")


def pose(view: ViewId) -> np.ndarray:
    """True pose, in a world that is neither upright nor about the axis."""
    moved = np.eye(4)
    moved[:3, :3] = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    moved[:3, :3] *= np.linalg.det(moved[:3, :3])
    moved[:3, 3] = 0.4, -0.2, 0.9
    return np.asarray(RIG.cam_from_world(int(view.camera[-1]), view.frame) @ moved)


VIEWS = [ViewId(frame, name) for frame in range(RIG.frames) for name in ("cam0", "cam1")]


@pytest.fixture
def model() -> SceneModel:
    there = [view for view in VIEWS if view != LOST]
    return SceneModel(
        reconstruction=None, lenses={}, cam_from_rig={}, reprojection_px=0.1, rungs=(), metric=False,
        poses={view: pose_of(pycolmap.Rigid3d(pose(view)[:3])) for view in there},
        points=dict.fromkeys(there, 100),
        errors=None,
    )  # fmt: skip


def test_the_axis_and_the_missed_stops_are_the_true_ones(model: SceneModel) -> None:
    assert STATED is not None
    axis = axis_of(model, STATED)
    assert axis is not None
    world = np.linalg.inv(RIG.cam_from_world(0, 0)) @ pose(ViewId(0, "cam0"))  # its axis is z through 0
    np.testing.assert_allclose(world[:3, :3] @ axis.direction, (0, 0, 1), atol=1e-6)
    np.testing.assert_allclose((world[:3, :3] @ axis.place + world[:3, 3])[:2], 0, atol=1e-6)
    first = RIG.cam_from_world(0, 0)[:3, :3]
    missed = []
    for frame in range(RIG.frames):
        turn = first.T @ RIG.cam_from_world(0, frame)[:3, :3]
        missed.append(
            (np.degrees(np.arctan2(turn[1, 0], turn[0, 0])) - STATED.degrees[frame] + 180) % 360 - 180
        )
    estimated = [axis.differences[ViewId(frame, "cam0")] for frame in range(RIG.frames)]
    np.testing.assert_allclose(estimated, np.subtract(missed, np.mean(missed)), atol=0.002)
    assert 0.1 < axis.rms < 0.3


@pytest.mark.parametrize("direction", [1, -1])
def test_a_view_without_features_stands_where_its_angle_says(model: SceneModel, direction: int) -> None:
    assert STATED is not None
    stated = STATED.model_copy(
        update={"degrees": {frame: direction * angle for frame, angle in STATED.degrees.items()}}
    )
    filled = with_angles(model, VIEWS, stated)
    assert [(rung.name, rung.taken) for rung in filled.rungs] == [
        ("turntable_angles", True),
        ("turntable_placing", True),
    ]
    error = filled.poses[LOST].matrix()[:3, :3] @ pose(LOST)[:3, :3].T
    assert np.degrees(np.arccos(np.clip((np.trace(error) - 1) / 2, -1, 1))) < 4 * STATED.spread
    place = -np.linalg.inv(filled.poses[LOST].matrix())[:3, 3] + np.linalg.inv(pose(LOST))[:3, 3]
    assert np.linalg.norm(place) < 0.7 * np.radians(4 * STATED.spread)
    assert filled.points[LOST] == 0


def test_angles_of_another_table_place_nothing(model: SceneModel) -> None:
    assert STATED is not None
    wrong = TurntableRecord(
        reason="a table", degrees={frame: 14.0 * frame for frame in range(24)}, spread=0.2
    )
    filled = with_angles(model, VIEWS, wrong)
    assert LOST not in filled.poses
    assert [rung.taken for rung in filled.rungs] == [False]
    assert "correct turntable.json" in filled.rungs[0].reason

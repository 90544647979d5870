"""Mounting of cameras by the motions of both: right within the stated errors, refused where undetermined."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.poses.rigs.hand_eye import tie
from imaging.errors import CalibrationError

DISTANCE, RATIO = 4.0, 2.5
"""Distance of the scene, in units of the first world, and ratio of these to those of the second."""
NOISE = 0.05
"""Degrees, and as much of the distance."""
B_FROM_A = np.eye(4)
B_FROM_A[:3, :3] = Rotation.from_euler("yxz", (172.0, 5.0, -8.0), degrees=True).as_matrix()
B_FROM_A[:3, 3] = 0.1, -0.05, -0.3
INSIDE = 3.4
"""Standard errors about the worst axis that hold 99 of 100 errors in three dimensions."""


def rigid(turn: np.ndarray, shift: np.ndarray) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.from_rotvec(turn, degrees=True).as_matrix(), shift
    return pose


def poses(
    turns: np.ndarray, places: np.ndarray, seed: int = 0, noise: float = NOISE
) -> tuple[np.ndarray, np.ndarray]:
    """Poses of both cameras by structure from motion: each in a world and units of its own."""
    rng = np.random.default_rng(seed)
    other_world = rigid(np.array([20.0, -70.0, 110.0]), np.array([1.0, 2.0, -0.5]))

    def measured(pose: np.ndarray) -> np.ndarray:
        off = np.radians(noise) * DISTANCE * rng.normal(size=3)
        return rigid(noise * rng.normal(size=3), off) @ pose

    a, b = [], []
    for turn, place in zip(turns, places, strict=True):
        pose = rigid(turn, np.zeros(3))
        pose[:3, 3] = -pose[:3, :3] @ place
        a.append(measured(pose))
        b.append(measured(B_FROM_A @ pose @ other_world))
        b[-1][:3, 3] /= RATIO
    return np.array(a), np.array(b)


def hand_held(seed: int, count: int = 12) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.normal(0, 12, (count, 3)), rng.normal(0, 0.5, (count, 3))


DISTANCES = (DISTANCE, DISTANCE / RATIO)


def test_exact_motions_give_the_exact_tie() -> None:
    a, b = poses(*hand_held(1), noise=0.0)
    mounting = tie(a, b, DISTANCES)
    np.testing.assert_allclose(mounting.b_from_a, B_FROM_A, atol=1e-6)
    turn, shift = mounting.a_world_from_b_world[:, :3], mounting.a_world_from_b_world[:, 3]
    assert np.cbrt(np.linalg.det(turn)) == pytest.approx(RATIO, rel=1e-6)
    for here, there in zip(a, b, strict=True):
        eyes = [-pose[:3, :3].T @ pose[:3, 3] for pose in (np.linalg.inv(B_FROM_A @ here), there)]
        mounted = B_FROM_A @ here
        np.testing.assert_allclose(turn @ eyes[1] + shift, -mounted[:3, :3].T @ mounted[:3, 3], atol=1e-6)


def test_errors_are_as_large_as_stated() -> None:
    inside, ratios = [], []
    for seed in range(40):
        mounting = tie(*poses(*hand_held(seed), seed=seed), DISTANCES)
        off = Rotation.from_matrix(mounting.b_from_a[:3, :3] @ B_FROM_A[:3, :3].T).magnitude()
        shift = np.linalg.norm(mounting.b_from_a[:3, 3] - B_FROM_A[:3, 3])
        scale = np.cbrt(np.linalg.det(mounting.a_world_from_b_world[:, :3])) / RATIO - 1
        errors = (
            np.degrees(off) / mounting.turn_error,
            shift / mounting.shift_error,
            abs(scale) / mounting.scale_error,
        )
        inside.append(np.array(errors) < INSIDE)
        ratios.append(errors)
    assert np.mean(inside, axis=0).min() > 0.97
    assert np.mean(ratios, axis=0).min() > 0.5  # and no larger than that


def test_one_pose_that_is_wrong_does_not_turn_the_cameras() -> None:
    a, b = poses(*hand_held(3, 16))
    b[5] = rigid(np.array([4.0, 0.0, -3.0]), np.array([0.1, 0.0, 0.0])) @ b[5]
    mounting = tie(a, b, DISTANCES)
    off = Rotation.from_matrix(mounting.b_from_a[:3, :3] @ B_FROM_A[:3, :3].T).magnitude()
    assert np.degrees(off) < 0.2


@pytest.mark.parametrize(
    ("turns", "places", "cause"),
    [
        (
            np.zeros((1, 3)),
            None,
            "without turning, which does not determine the shift: turn it to the sides and up and",
        ),
        (np.array([[0.0, 1.0, 0.0]]), None, "about one axis only"),
        (np.ones((1, 3)), np.zeros(3), "about one point, as on a tripod"),
    ],
    ids=["no turn", "one axis", "tripod"],
)
def test_motions_that_do_not_tell_are_refused(
    turns: np.ndarray, places: np.ndarray | None, cause: str
) -> None:
    for seed in range(10):
        every, walked = hand_held(seed)
        with pytest.raises(CalibrationError, match=cause):
            tie(*poses(every * turns, walked if places is None else walked * places, seed), DISTANCES)


def test_a_camera_far_from_the_point_that_the_rig_turns_about_is_refused_too() -> None:
    """On the pan head the cameras move, and all the same nothing tells how their scenes compare."""
    turns, _ = hand_held(7)
    arm = np.array([0.4, 0.1, -0.6])
    places = np.array([-Rotation.from_rotvec(turn, degrees=True).inv().apply(arm) for turn in turns])
    with pytest.raises(CalibrationError, match="about one point"):
        tie(*poses(turns, places), DISTANCES)


def test_too_few_frames_are_refused() -> None:
    with pytest.raises(CalibrationError, match="only 4 frames have poses of both, and 5 are needed"):
        tie(*poses(*hand_held(1, 4)), DISTANCES)


def test_too_little_motion_for_such_poses_is_refused() -> None:
    turns, places = hand_held(2)
    with pytest.raises(CalibrationError, match="only: take more frames"):
        tie(*poses(turns / 4, places / 8, noise=0.25), DISTANCES)


def test_cameras_that_turn_against_each_other_are_refused() -> None:
    a, b = poses(*hand_held(5))
    rng = np.random.default_rng(5)
    loose = np.array([rigid(rng.normal(0, 3, 3), np.zeros(3)) @ pose for pose in b])
    with pytest.raises(CalibrationError, match="did not move as one"):
        tie(a, loose, DISTANCES)

"""COLMAP's measure of poses against its definition, pair by pair with scipy's rotations."""

import itertools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from recon.measure.protocols.eth3d import areas_below, measure, name_of, relative_errors

rng = np.random.default_rng(8)


def pose(turn: Rotation, centre) -> np.ndarray:
    motion = np.eye(4)
    motion[:3, :3] = turn.as_matrix()
    motion[:3, 3] = -turn.apply(centre)
    return motion


TRUE = {f"cam/{n}.png": pose(Rotation.random(rng=rng), rng.normal(size=3)) for n in range(6)}
ESTIMATED = {
    name: pose(
        Rotation.from_rotvec(rng.normal(0, 0.01, 3)) * Rotation.from_matrix(motion[:3, :3]),
        -motion[:3, :3].T @ motion[:3, 3] + rng.normal(0, 0.01, 3),
    )
    for name, motion in TRUE.items()
}


def pair_by_pair(estimated, true) -> list[float]:
    errors = []
    for source, target in itertools.permutations(sorted(true), 2):
        ours = estimated[target] @ np.linalg.inv(estimated[source])
        theirs = true[target] @ np.linalg.inv(true[source])
        between = Rotation.from_matrix(ours[:3, :3].T @ theirs[:3, :3])
        directions = [motion[:3, 3] / np.linalg.norm(motion[:3, 3]) for motion in (ours, theirs)]
        apart = 2 * np.arcsin(np.linalg.norm(directions[0] - directions[1]) / 2)
        errors.append(max(np.rad2deg(between.magnitude()), np.rad2deg(apart)))
    return errors


def test_errors_are_those_of_each_ordered_pair():
    expected = sorted(pair_by_pair(ESTIMATED, TRUE))
    np.testing.assert_allclose(sorted(relative_errors(ESTIMATED, TRUE)), expected, atol=1e-6)


def test_a_similarity_changes_nothing():
    move = pose(Rotation.random(rng=rng), [3, -1, 4])
    moved = {name: motion @ move for name, motion in TRUE.items()}
    for motion in moved.values():
        motion[:3, 3] *= 7
    assert relative_errors(moved, TRUE).max() < 1e-5
    assert measure(moved, TRUE) == pytest.approx({"placed": 100} | dict.fromkeys(AREAS, 100.0))


AREAS = ("auc_0.5", "auc_1", "auc_5", "auc_10")


def test_images_that_are_lost_or_of_elsewhere_count_in_all_their_pairs():
    lost = {name: motion for name, motion in TRUE.items() if name != "cam/3.png"}
    errors = relative_errors(lost, TRUE)
    assert (len(errors), int((errors == 180).sum())) == (30, 10)
    errors = relative_errors(TRUE | {"else/0.png": np.eye(4)}, TRUE)
    assert (len(errors), int((errors == 180).sum())) == (42, 12)
    assert measure({}, TRUE) == {"placed": 0} | dict.fromkeys(AREAS, 0.0)


def test_coinciding_cameras_have_no_direction():
    true = {"a": pose(Rotation.identity(), [0, 0, 0]), "b": pose(Rotation.identity(), [0, 0, 0.0005])}
    wrong = {"a": true["a"], "b": pose(Rotation.identity(), [1, 0, 0])}
    assert relative_errors(wrong, true).max() == 0


@pytest.mark.parametrize(
    ("errors", "threshold", "area"),
    [
        ([0.5, 180], 1, 100 * (0.499 * 0.5 / 2 + 0.5 * 0.5)),  # rises from the accuracy on, then holds
        ([0.0, 0.0], 5, 100.0),
        ([0.0, 2.0], 4, 100 * (0.5 * 0.001 + 0.75 * 1.999 + 1.0 * 2) / 4),
        ([3.0], 1, 0.0),
    ],
)
def test_area_by_hand(errors, threshold, area):
    assert areas_below(np.array(errors), [threshold]) == pytest.approx([area], abs=1e-9)


def test_images_are_named_as_the_model_does():
    assert name_of("/data/terrains/images/images_rig_cam4_undistorted/7.png") == (
        "images_rig_cam4_undistorted/7.png"
    )

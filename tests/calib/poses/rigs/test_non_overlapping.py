"""Cameras of a rig that see nothing in common, tied together by how both of them move."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.data.features import Features, MatchedPair
from calib.poses.pose_inputs import PoseInputs
from calib.poses.rigs.non_overlapping import cameras_apart
from calib.poses.sfm import SceneModel, centres, solve
from imaging.optics.lens import Lens
from imaging.session.calibration import MOTION
from imaging.session.records import Rung
from imaging.session.view_id import ViewId

WIDTH, HEIGHT, FOCAL = 640, 480, 620.0
GUESS = Lens(model="SIMPLE_RADIAL", width=WIDTH, height=HEIGHT, fx=640.0, fy=640.0, cx=320.0, cy=240.0)
RIG = ("back", "front")
FRAMES, COUNT = 10, 1200
BACK_FROM_FRONT = np.eye(4)
BACK_FROM_FRONT[:3, :3] = Rotation.from_euler("yxz", (176.0, 3.0, -2.0), degrees=True).as_matrix()
BACK_FROM_FRONT[:3, 3] = 0.05, 0.02, -0.2


def hall() -> tuple[np.ndarray, np.ndarray]:
    """Points of the walls ahead and behind, and descriptors that no two share."""
    rng = np.random.default_rng(5)
    world = rng.uniform(-1, 1, (COUNT, 3)) * (5.0, 3.0, 1.0)
    world[:, 2] += np.where(np.arange(COUNT) % 2, 5.0, -5.0)
    return world, rng.exponential(30, (COUNT, 128))


WORLD, DESCRIPTORS = hall()


def motion(turns: np.ndarray, places: np.ndarray) -> list[np.ndarray]:
    """front_from_world [4, 4] of each frame; turns: rotation vectors, degrees."""
    poses = []
    for turn, place in zip(turns, places, strict=True):
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_rotvec(turn, degrees=True).as_matrix()
        pose[:3, 3] = -pose[:3, :3] @ place
        poses.append(pose)
    return poses


def walk(count: int = FRAMES) -> tuple[np.ndarray, np.ndarray]:
    """Turns about several axes, and places."""
    step = np.arange(count)
    turns = np.stack([12 * np.sin(1.3 * step), 14 * np.sin(0.8 * step + 1), 10 * np.cos(1.9 * step)], axis=1)
    places = np.stack([0.22 * step - 1, 0.3 * np.sin(1.1 * step), 0.4 * np.cos(0.7 * step)], axis=1)
    return turns, places


def features_of(pose: np.ndarray, seed: int) -> Features:
    rng = np.random.default_rng(seed)
    x, y, z = (WORLD @ pose[:3, :3].T + pose[:3, 3]).T
    u, v = FOCAL * x / z + WIDTH / 2, FOCAL * y / z + HEIGHT / 2
    inside = np.flatnonzero((u > 0) & (u < WIDTH) & (v > 0) & (v < HEIGHT) & (z > 0.1))
    rng.shuffle(inside)
    points = np.stack([u, v], 1)[inside] + rng.normal(0, 0.2, (len(inside), 2))
    noisy = DESCRIPTORS[inside] + rng.normal(0, 2, (len(inside), 128))
    return Features(points, np.clip(noisy, 0, 255).astype(np.uint8))


def pictures(poses: list[np.ndarray]) -> dict[ViewId, Features]:
    features = {}
    for frame, pose in enumerate(poses):
        features[ViewId(frame, "front")] = features_of(pose, 2 * frame)
        features[ViewId(frame, "back")] = features_of(BACK_FROM_FRONT @ pose, 2 * frame + 1)
    return features


def placed(poses: list[np.ndarray], rigs: list[tuple[str, ...]]) -> SceneModel:
    return solve(PoseInputs(pictures(poses), rigs), dict.fromkeys(RIG, GUESS))


@pytest.fixture(scope="module")
def model() -> SceneModel:
    return placed(motion(*walk()), [RIG])


def off(model: SceneModel) -> float:
    """Degrees by which the cameras are not mounted to each other as they are."""
    back, front = (model.cam_from_rig[name].matrix()[:3, :3] for name in RIG)
    return float(np.degrees(Rotation.from_matrix(back @ front.T @ BACK_FROM_FRONT[:3, :3].T).magnitude()))


def motion_rung(model: SceneModel) -> Rung:
    (rung,) = (rung for rung in model.rungs if rung.name == MOTION)
    return rung


def test_motion_ties_cameras_that_see_nothing_in_common(model: SceneModel) -> None:
    assert len(model.poses) == 2 * FRAMES
    assert any(rung.name == "rig_constraint" and rung.taken for rung in model.rungs)
    assert motion_rung(model).taken
    assert "in common with front; how front and back moved" in motion_rung(model).reason
    assert len(model.by_motion) == 1
    assert model.reprojection_px < 0.3
    assert off(model) < 0.1
    # The rig is rigid, and everything stands in one world of one size.
    turns, places = walk()
    eyes = centres(
        [model.poses[ViewId(frame, name)] for name in ("front", "back") for frame in range(FRAMES)]
    )
    behind = places - np.array(
        [
            pose[:3, :3].T @ BACK_FROM_FRONT[:3, :3].T @ BACK_FROM_FRONT[:3, 3]
            for pose in motion(turns, places)
        ]
    )
    truth = np.concatenate([places, behind])
    apart = np.linalg.norm(eyes[:, None] - eyes, axis=-1)
    true_apart = np.linalg.norm(truth[:, None] - truth, axis=-1)
    assert apart * true_apart.sum() / apart.sum() == pytest.approx(true_apart, abs=0.02 * true_apart.max())


def test_the_error_of_the_tie_is_stated(model: SceneModel) -> None:
    assert model.errors is not None
    ((turn, shift),) = model.errors.mounted.values()
    assert off(model) < 2.8 * turn < 0.3
    assert 0 < shift < 0.05
    # Views of one camera are surer of each other than of those of the other.
    assert turn > 1.3 * max(model.errors.rotation.values())


def test_cameras_that_are_not_mounted_to_each_other_are_not_tied() -> None:
    model = placed(motion(*walk(6)), [])
    assert len(model.poses) == 6
    assert not [rung for rung in model.rungs if rung.name == MOTION]
    assert not model.by_motion


@pytest.mark.parametrize(
    ("still", "cause"),
    [((0, 0, 0), "moved without turning"), ((0, 1, 0), "about one axis only")],
    ids=["no turn", "one axis"],
)
def test_motion_that_tells_nothing_leaves_a_camera_without_poses(
    still: tuple[int, int, int], cause: str
) -> None:
    turns, places = walk(6)
    model = placed(motion(turns * np.array(still), places), [RIG])
    assert len({view.camera for view in model.poses}) == 1
    assert not motion_rung(model).taken
    assert cause in motion_rung(model).reason
    assert not model.by_motion
    assert len(model.poses) == 6


def test_a_camera_that_moves_on_its_own_is_not_tied() -> None:
    turns, places = walk(6)
    loose = [np.array(pose) @ np.eye(4) for pose in motion(turns[::-1] * 0.8, places[::-1])]
    features = {}
    for frame, (pose, other) in enumerate(zip(motion(turns, places), loose, strict=True)):
        features[ViewId(frame, "front")] = features_of(pose, 2 * frame)
        features[ViewId(frame, "back")] = features_of(BACK_FROM_FRONT @ other, 2 * frame + 1)
    model = solve(PoseInputs(features, [RIG]), dict.fromkeys(RIG, GUESS))
    assert "did not move as one" in motion_rung(model).reason
    assert len(model.poses) == 6


def test_only_cameras_that_nothing_joins_are_apart() -> None:
    def pairs(*links: tuple[str, str, int]) -> dict[tuple[ViewId, ViewId], MatchedPair]:
        return {
            (ViewId(number, one), ViewId(number + 50, other)): MatchedPair(
                np.zeros((count, 2)), np.zeros((count, 2)), np.zeros((count, 2), np.uint32)
            )
            for number, (one, other, count) in enumerate(links)
        }

    here = [("a", "a", 200), ("a", "a", 300)]
    placed_views = {ViewId(0, "a"), ViewId(50, "a"), ViewId(1, "a"), ViewId(51, "a")}

    def apart(*links: tuple[str, str, int], rigs: list[list[str]] | None = None) -> set[str]:
        return set(cameras_apart(rigs or [["a", "b", "c"]], pairs(*here, *links), placed_views))

    assert apart(("b", "b", 100)) == {"b"}
    assert apart(("b", "b", 100), ("a", "b", 30)) == {"b"}  # such a pair may be chance
    assert apart(("b", "b", 100), ("a", "b", 150)) == set()
    assert apart(("b", "b", 100), ("b", "c", 150), ("a", "c", 150)) == set()
    assert apart(("b", "c", 100)) == {"b", "c"}
    assert apart(("a", "b", 20)) == set()
    assert apart(("b", "b", 100), rigs=[["a"], ["b"]]) == set()

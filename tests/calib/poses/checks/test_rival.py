"""A second mapper, which places all views at once: what it adds, and what it refuses."""

from typing import Any

import numpy as np
import pytest

from calib.data.features import Features, fill_database
from calib.data.unfinished import Unfinished
from calib.poses import first_model
from calib.poses.checks.contradictions import placed_views
from calib.poses.checks.rival import FEWEST_HANGING, agreement, hanging_on, joined_groups
from calib.poses.mapping import map_at_once
from calib.poses.pose_inputs import PoseInputs
from calib.poses.resolution import Contradicted
from calib.poses.sfm import SceneModel, solve, transformed
from imaging.files.colmap import pycolmap
from imaging.optics.lens import Lens
from imaging.progress import unreported
from imaging.session.calibration import POSE_HANGING
from imaging.session.view_id import ViewId

SIZE, FOCAL, VIEWS, FEW = 500, 550.0, 12, 4
FILE = Lens(model="SIMPLE_RADIAL", width=SIZE, height=SIZE, fx=FOCAL, fy=FOCAL, cx=250, cy=250)


def pose(view: int) -> np.ndarray:
    """cam_from_world [4, 4] of a view of a ring of radius 4, which looks at its middle."""
    angle = 2 * np.pi * view / VIEWS
    centre = 4 * np.array([np.cos(angle), np.sin(angle), 0.3])
    forward = -centre / np.linalg.norm(centre)
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    made = np.eye(4)
    made[:3, :3] = np.stack([right, np.cross(forward, right), forward])
    made[:3, 3] = -made[:3, :3] @ centre
    return made


@pytest.fixture(scope="module")
def ring() -> dict[ViewId, Features]:
    """What each view sees of the nearer side of a ball of points."""
    rng = np.random.default_rng(8)
    world = rng.normal(size=(500, 3))
    world /= np.linalg.norm(world, axis=1)[:, None]
    descriptors = rng.exponential(30, (len(world), 128))
    views = {}
    for view in range(VIEWS):
        made = pose(view)
        centre = -made[:3, :3].T @ made[:3, 3]
        x, y, z = (world @ made[:3, :3].T + made[:3, 3]).T
        facing = np.flatnonzero((world * (centre - world)).sum(1) > 0.3)
        places = np.stack([FOCAL * x / z + 250, FOCAL * y / z + 250], axis=1)[facing]
        places += rng.normal(0, 0.2, places.shape)
        noisy = descriptors[facing] + rng.normal(0, 2, (len(facing), 128))
        views[ViewId(view, "cam")] = Features(places, np.clip(noisy, 0, 255).astype(np.uint8))
    return views


def only(model: Any, count: int) -> Any:
    """The model with its first views only."""
    copy = type(model)(model)
    for view in sorted(placed_views(copy))[count:]:
        copy.deregister_frame(copy.find_image_with_name(view.image_name).frame_id)
    return copy


def turns(model: Any) -> dict[ViewId, np.ndarray]:
    return {view: one.matrix()[:3, :3] for view, one in model.poses.items()}


def test_views_that_one_by_one_leaves_out_are_placed_at_once(
    ring: dict[ViewId, Features], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where the incremental mapper stops after a few views, the other places all, rightly."""
    one_by_one = first_model.map_views
    monkeypatch.setattr(first_model, "map_views", lambda *a, **k: only(one_by_one(*a, **k), FEW))
    model = solve(PoseInputs(ring), {"cam": FILE})
    (rung,) = (rung for rung in model.rungs if rung.name == "at_once")
    assert rung.taken
    assert f"only {FEW} of {VIEWS} views" in rung.reason
    assert len(model.poses) == VIEWS
    rotations = turns(model)
    for view in rotations:
        goal = pose(view.frame)[:3, :3] @ pose(0)[:3, :3].T
        miss = rotations[view] @ rotations[ViewId(0, "cam")].T @ goal.T
        assert np.degrees(np.arccos(np.clip((np.trace(miss) - 1) / 2, -1, 1))) < 0.3


def test_all_views_placed_one_by_one_ask_no_rival(
    ring: dict[ViewId, Features], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []
    monkeypatch.setattr(first_model, "map_at_once", lambda *a: asked.append(a))
    assert len(solve(PoseInputs(ring), {"cam": FILE}).poses) == VIEWS
    assert not asked


def test_unconfirmed_poses_that_the_rival_contradicts_are_refused(
    ring: dict[ViewId, Features], monkeypatch: pytest.MonkeyPatch
) -> None:
    one_by_one = first_model.map_views
    monkeypatch.setattr(first_model, "map_views", lambda *a, **k: only(one_by_one(*a, **k), FEW))
    monkeypatch.setattr(first_model, "agreement", lambda one, other: 0.4)
    with pytest.raises(Contradicted, match=r"40 % of the turns.*--keep-doubtful"):
        solve(PoseInputs(ring), {"cam": FILE})


def test_agreement_of_models(ring: dict[ViewId, Features], monkeypatch: pytest.MonkeyPatch) -> None:
    """All turns of a model agree with its own; few views tell nothing."""
    made = []
    one_by_one = first_model.map_views

    def mapped(*rest: Any, **more: Any) -> Any:
        made.append(one_by_one(*rest, **more))
        return made[-1]

    monkeypatch.setattr(first_model, "map_views", mapped)
    solve(PoseInputs(ring), {"cam": FILE})
    (model,) = made
    assert agreement(model, only(model, 5)) == 1.0
    assert agreement(model, only(model, 2)) is None
    assert agreement(model, None) is None
    folded = type(model)(model)
    last = folded.find_image_with_name(ViewId(VIEWS - 1, "cam").image_name).frame
    first = folded.find_image_with_name(ViewId(0, "cam").image_name).frame
    last.rig_from_world = first.rig_from_world
    assert agreement(model, folded) == pytest.approx(1 - 2 / VIEWS)


def test_two_views_are_not_placed_at_once(
    ring: dict[ViewId, Features], capfd: pytest.CaptureFixture[str]
) -> None:
    """Without a third view there is no model, and nothing is printed about it."""
    database = pycolmap.Database.open(":memory:")
    cameras = {"cam": pycolmap.Camera.create_from_model_name(0, "SIMPLE_RADIAL", FOCAL, SIZE, SIZE)}
    two = {view: ring[view] for view in sorted(ring)[:2]}
    assert fill_database(database, cameras, two, 2.0, [], Unfinished(), unreported)
    assert map_at_once(database, frozenset()) is None
    assert capfd.readouterr().err == ""


def test_views_behind_one_pair_are_a_group_of_their_own() -> None:
    """Two rings of four that one pair joins; a second pair or enough points between them make them one."""
    ring = [(0, 1), (1, 2), (2, 3), (0, 3)]
    pairs = [*ring, *((one + 4, other + 4) for one, other in ring), (3, 4)]
    two = [{0, 1, 2, 3}, {4, 5, 6, 7}]
    assert joined_groups(pairs, range(8), []) in (two, two[::-1])
    assert joined_groups([*pairs, (1, 6)], range(8), []) == [set(range(8))]
    assert joined_groups(pairs, range(8), [(2, 3, 4)] * 15) == [set(range(8))]
    for tracks in ([(2, 3, 4)] * 14, [(3, 4)] * 100, [(1, 2, 3)] * 100, [(3, 4, 4)] * 100):
        assert joined_groups(pairs, range(8), tracks) in (two, two[::-1])
    assert [len(group) for group in joined_groups([(0, 1), (1, 2)], range(4), [])] == [1, 1, 1, 1]
    assert joined_groups(pairs, range(4), []) == [{0, 1, 2, 3}]


def test_a_view_alone_on_its_pair_may_hang_there() -> None:
    """Of a ring, one view hangs on a pair, two on another: the first may be placed, where points hold it."""
    pairs = [(0, 1), (1, 2), (0, 2), (2, 3), (1, 4), (4, 5)]
    tracks = [(1, 2, 3)] * FEWEST_HANGING + [(0, 1, 4)] * 7 + [(1, 4, 5)] * 7
    assert joined_groups(pairs, range(6), tracks)[0] == {0, 1, 2}
    assert hanging_on(pairs, {3, 4, 5}, tracks) == {3}
    assert hanging_on(pairs, {3, 4, 5}, tracks[1:]) == set()
    assert hanging_on(pairs, {3, 4, 5}, [(2, 3), (2, 3, 3), *tracks[1:]]) == set()
    assert hanging_on(pairs, set(), tracks) == set()


def hung(
    ring: dict[ViewId, Features], monkeypatch: pytest.MonkeyPatch, count: int, *, keep_doubtful: bool = False
) -> SceneModel:
    """The ring placed at once, its last `count` views said to be outside the largest group."""
    one_by_one = first_model.map_views
    monkeypatch.setattr(first_model, "map_views", lambda *a, **k: only(one_by_one(*a, **k), FEW))
    monkeypatch.setattr(
        first_model,
        "joined_groups",
        lambda pairs, views, tracks: [set(sorted(views)[:-count]), set(sorted(views)[-count:])],
    )
    names = {view: f"IMG_{view.frame}.JPG" for view in ring}
    return solve(PoseInputs(ring, keep_doubtful=keep_doubtful, names=names), {"cam": FILE})


def test_one_view_that_one_pair_joins_is_placed_and_named(
    ring: dict[ViewId, Features], monkeypatch: pytest.MonkeyPatch
) -> None:
    model = hung(ring, monkeypatch, 1)
    assert len(model.poses) == VIEWS
    assert model.hanging == {ViewId(VIEWS - 1, "cam")}
    (rung,) = (rung for rung in model.rungs if rung.name == POSE_HANGING)
    assert rung.taken
    assert "connects IMG_11.JPG to the others" in rung.reason
    assert "its pose may be wrong" in rung.reason
    assert transformed(model, pycolmap.Sim3d(2 * np.eye(3, 4))).hanging == model.hanging


def test_many_views_that_one_pair_joins_are_left_out_unless_they_are_kept(
    ring: dict[ViewId, Features], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A group on one pair turns with it; kept at the user's wish, each of its views is named."""
    model = hung(ring, monkeypatch, 5)
    assert sorted(view.frame for view in model.poses) == list(range(VIEWS - 5))
    assert POSE_HANGING not in {rung.name for rung in model.rungs}
    model = hung(ring, monkeypatch, 5, keep_doubtful=True)
    assert len(model.poses) == VIEWS
    (rung,) = (rung for rung in model.rungs if rung.name == POSE_HANGING)
    for view in range(VIEWS - 5, VIEWS):
        assert f"IMG_{view}.JPG" in rung.reason
    assert "their poses may be wrong" in rung.reason


def test_what_only_one_pair_joins_is_not_placed_at_once(
    ring: dict[ViewId, Features], monkeypatch: pytest.MonkeyPatch
) -> None:
    one_by_one = first_model.map_views
    monkeypatch.setattr(first_model, "map_views", lambda *a, **k: only(one_by_one(*a, **k), FEW))
    monkeypatch.setattr(
        first_model,
        "joined_groups",
        lambda pairs, views, tracks: [set(sorted(views)[FEW:]), set(sorted(views)[:FEW])],
    )
    model = solve(PoseInputs(ring), {"cam": FILE})
    assert not [rung for rung in model.rungs if rung.name == "at_once"]
    assert sorted(view.frame for view in model.poses) == list(range(FEW))

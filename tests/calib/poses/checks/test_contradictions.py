"""Scenes that look alike from several sides: views stand where they were, or are left out by name."""

from collections.abc import Mapping
from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest

from calib.data.features import Features, MatchedPair
from calib.poses.checks.brightness_steps import warning
from calib.poses.pose_inputs import PoseInputs
from calib.poses.resolution import resolve_contradictions
from calib.poses.sfm import SceneModel, solve
from imaging.arrays import Array
from imaging.errors import CalibrationError
from imaging.files.colmap import pycolmap
from imaging.optics.lens import Lens
from imaging.session.view_id import ViewId

WIDTH, HEIGHT, FOCAL = 320, 240, 300.0
LENS = Lens(
    model="SIMPLE_RADIAL", width=WIDTH, height=HEIGHT, fx=FOCAL, fy=FOCAL, cx=WIDTH / 2, cy=HEIGHT / 2
)
SIDES, VIEWS, POINTS = 2, 16, 250


def camera(view: int) -> Array:
    """cam_from_world [4, 4] of a camera on a ring about a pillar at the origin, now above it, now below."""
    turn, tilt = np.radians(360 / VIEWS * view), np.radians(8 * (-1) ** view)
    c, s = np.cos(turn), np.sin(turn)
    pose = np.eye(4)
    pose[:3, :3] = [[c, 0, -s], [0, 1, 0], [s, 0, c]]
    c, s = np.cos(tilt), np.sin(tilt)
    pose[:3, :3] = [[1, 0, 0], [0, c, -s], [0, s, c]] @ pose[:3, :3]
    pose[:3, 3] = 0, 0, 4
    return pose


def pillar(alike: bool, lit: bool) -> tuple[dict, dict, Array]:
    """Features and brightness of all views of a round pillar, and the true poses.

    alike: its four sides have the same points. lit: by a light on one side, else from everywhere.
    """
    rng = np.random.default_rng(1)
    within, height = rng.uniform(0, 360 / SIDES, POINTS), rng.uniform(-1, 1, POINTS)
    vectors = rng.normal(size=(SIDES, POINTS, 128))
    if alike:
        vectors[:] = vectors[0]
    around = np.radians((within + 360 / SIDES * np.arange(SIDES)[:, None]).ravel())
    normal = np.stack([np.sin(around), np.zeros(len(around)), -np.cos(around)], axis=1)
    world = normal + np.tile(height, SIDES)[:, None] * (0, 1, 0)
    light = np.log(1.2 + normal[:, 0] * 0.8) if lit else np.zeros(len(world))
    poses = np.stack([camera(view) for view in range(VIEWS)])
    features, brightness = {}, {}
    for view, pose in enumerate(poses):
        place = world @ pose[:3, :3].T + pose[:3, 3]
        pixels = FOCAL * place[:, :2] / place[:, 2:] + (WIDTH / 2, HEIGHT / 2)
        facing = ((place * (normal @ pose[:3, :3].T)).sum(1) < -1.2) & (np.abs(pixels[:, 1] - 120) < 118)
        visible = rng.permutation(np.flatnonzero(facing))
        noisy = vectors.reshape(-1, 128)[visible] + 0.1 * rng.normal(size=(len(visible), 128))
        points = pixels[visible] + rng.normal(0, 0.2, (len(visible), 2))
        features[ViewId(view, "cam")] = Features(points, np.clip(128 + 30 * noisy, 0, 255).astype(np.uint8))
        brightness[ViewId(view, "cam")] = light[visible] + rng.normal(0, 0.02, len(visible))
    return features, brightness, poses


def placed(
    features: Mapping, brightness: Mapping, *, steady: bool = True, keep_doubtful: bool = False
) -> tuple[SceneModel, Mapping]:
    """The model, and the pairs of views that match."""
    with patch("calib.poses.first_model.resolve_contradictions", wraps=resolve_contradictions) as settled:
        model = solve(
            PoseInputs(
                features,
                focal_known={"cam"},
                brightness=brightness,
                steady={"cam"} if steady else (),
                keep_doubtful=keep_doubtful,
            ),
            {"cam": LENS},
        )
    return model, settled.call_args.args[1].pairs


def wrong(model: SceneModel, poses: Array) -> list[int]:
    """The views that do not turn against their neighbours as they do in truth."""
    turns = {view.frame: pose.matrix()[:3, :3] for view, pose in model.poses.items()}
    worlds = {frame: poses[frame, :3, :3].T @ turn for frame, turn in turns.items()}
    votes = {
        frame: sum(np.linalg.norm(world - other) < 0.05 for other in worlds.values())
        for frame, world in worlds.items()
    }
    best = max(votes, key=votes.__getitem__)
    return [frame for frame, world in worlds.items() if np.linalg.norm(world - worlds[best]) > 0.05]


def rung(model: SceneModel):
    return next(rung for rung in model.rungs if rung.name == "pose_contradictions")


def test_all_views_of_a_pillar_that_is_unique_stay_and_one_sided_light_is_warned_of():
    """A warning where neighbours are not as bright: as of a crate whose corners are passed in steps that
    match nothing, so that one side stands before another and no pair contradicts it."""
    features, brightness, poses = pillar(alike=False, lit=True)
    model, pairs = placed(features, brightness)
    assert len(model.poses) == VIEWS
    assert wrong(model, poses) == []
    assert not model.contradicted
    assert not rung(model).taken
    assert not any(rung.name.startswith("pose_") for rung in model.rungs if rung.taken)
    stand = {key: pose.matrix() for key, pose in model.poses.items()}
    assert warning(stand, pairs, brightness, {"cam"}) is None
    darker = {key: values - 0.5 * (key.frame % 2) for key, values in brightness.items()}
    assert "differ in brightness by more than 10 %" in warning(stand, pairs, darker, {"cam"})
    assert warning(stand, pairs, darker, set()) is None


def test_light_tells_sides_apart_that_look_alike():
    features, brightness, poses = pillar(alike=True, lit=True)
    model, _ = placed(features, brightness)
    assert wrong(model, poses) == []
    assert len(model.poses) == VIEWS
    assert "lit differently" in rung(model).reason


def test_sides_that_nothing_tells_apart_are_refused():
    features, brightness, _ = pillar(alike=True, lit=False)
    with pytest.raises(CalibrationError, match="parts of a scene look alike: put something unique"):
        placed(features, brightness)


def test_sides_that_nothing_tells_apart_are_kept_and_named_on_request():
    features, brightness, _ = pillar(alike=True, lit=False)
    model, _ = placed(features, brightness, keep_doubtful=True)
    assert len(model.poses) == VIEWS
    (doubt,) = (rung for rung in model.rungs if rung.name == "pose_undecided")
    assert "all are kept by --keep-doubtful: poses of 0000/cam" in doubt.reason


def with_false_pair(features: Mapping, brightness: Mapping, steady: bool) -> SceneModel:
    """Views placed where one more pair matches, of opposite sides, by places drawn at random."""
    rng = np.random.default_rng(3)
    one, other = ViewId(0, "cam"), ViewId(VIEWS // 2, "cam")
    index = np.stack([rng.permutation(60), rng.permutation(60)], axis=1).astype(np.uint32)
    false = MatchedPair(features[one].points[index[:, 0]], features[other].points[index[:, 1]], index)

    def resolved(model, matches, **more):
        return resolve_contradictions(
            model, replace(matches, pairs={**matches.pairs, (one, other): false}), **more
        )

    with patch("calib.poses.first_model.resolve_contradictions", resolved):
        return solve(
            PoseInputs(
                features, focal_known={"cam"}, brightness=brightness, steady={"cam"} if steady else ()
            ),
            {"cam": LENS},
        )


@pytest.mark.parametrize("steady", [False, True])
def test_light_that_the_poses_refute_deletes_nothing(steady):
    """Every second view is half as bright, by its exposure or by shine, and one pair of views is false."""
    features, brightness, poses = pillar(alike=False, lit=True)
    darker = {key: values - 0.7 * (key.frame % 2) for key, values in brightness.items()}
    model = with_false_pair(features, darker, steady)
    assert len(model.poses) == VIEWS
    assert wrong(model, poses) == []
    assert "lit differently" not in rung(model).reason
    assert "1 are outvoted by the others" in rung(model).reason


def test_poses_of_two_views_are_doubted():
    features, brightness, _ = pillar(alike=False, lit=True)
    pair = {key: of_view for key, of_view in features.items() if key.frame < 2}
    model, _ = placed(pair, brightness)
    assert len(model.poses) == 2
    (doubt,) = (rung for rung in model.rungs if rung.name == "pose_unconfirmed")
    assert doubt.taken
    assert doubt.reason.startswith("only 2 views match, and no third confirms their poses")


def test_poses_are_doubted_where_no_third_view_sees_what_two_do():
    """Try ten views before rows of windows that stood on a line, 13 % of whose points a third view saw."""
    features, brightness, _ = pillar(alike=False, lit=True)
    rungs = []

    def resolved(model, matches, **more):
        of_two = pycolmap.Reconstruction(model)
        for number, point in model.points3D.items():
            for element in point.track.elements[2:]:
                of_two.delete_observation(element.image_id, element.point2D_idx)
            assert len(of_two.points3D[number].track.elements) == 2
        rungs.extend(resolve_contradictions(of_two, matches, **more).rungs)
        return resolve_contradictions(model, matches, **more)

    with patch("calib.poses.first_model.resolve_contradictions", resolved):
        solve(PoseInputs(features, focal_known={"cam"}, brightness=brightness), {"cam": LENS})
    (doubt,) = (rung for rung in rungs if rung.taken)
    assert doubt.name == "pose_unconfirmed"
    assert doubt.reason.startswith("only 0 % of the scene's points are confirmed by a third view")

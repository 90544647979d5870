"""Poses from features whose truth is known, and the causes that are named when there can be none."""

import numpy as np
import pytest

from calib.data.features import Features, MatchedPair
from calib.data.matching import match
from calib.poses.pose_inputs import PoseInputs
from calib.poses.sfm import centres, solve
from imaging.errors import CalibrationError
from imaging.optics.lens import Lens
from imaging.session.view_id import ViewId

WIDTH, HEIGHT, FOCAL = 640, 480, 620.0
GUESS = Lens(
    model="SIMPLE_RADIAL", width=WIDTH, height=HEIGHT, fx=700.0, fy=700.0, cx=WIDTH / 2, cy=HEIGHT / 2
)
NO_INDEX = np.empty((0, 2), np.uint32)
RNG = np.random.default_rng(7)
POINTS = RNG.uniform(-1, 1, (600, 3)) * (1.2, 0.9, 0.7)
DESCRIPTORS = RNG.exponential(30, (600, 128))


def turned(degrees):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])


def features_of(rotation, translation, noise=0.2, seed=0, k1=0.0, scene=POINTS):
    """Features of the points in a camera; descriptors with a little noise, in an order of their own."""
    rng = np.random.default_rng(seed)
    x, y, z = (scene @ rotation.T + translation).T
    bent = FOCAL / z * (1 + k1 * (x**2 + y**2) / z**2)
    u, v = bent * x + WIDTH / 2, bent * y + HEIGHT / 2
    inside = np.flatnonzero((u > 0) & (u < WIDTH) & (v > 0) & (v < HEIGHT) & (z > 0.1))
    rng.shuffle(inside)
    points = np.stack([u, v], 1)[inside] + rng.normal(0, noise, (len(inside), 2))
    noisy = DESCRIPTORS[inside] + rng.normal(0, 2, (len(inside), 128))
    return Features(points, np.clip(noisy, 0, 255).astype(np.uint8))


def arc(count, offset=(0.0, 0.0, 0.0)):
    return [(turned(8.0 * i), np.array([0, 0, 4.0]) + offset) for i in range(count)]


def test_matching_finds_the_same_points():
    first, second = features_of(*arc(2)[0], seed=1), features_of(*arc(2)[1], seed=2)
    pairs = match(first.descriptors, second.descriptors)
    assert len(pairs) > 400
    ours, theirs = first.descriptors[pairs[:, 0]].astype(float), second.descriptors[pairs[:, 1]].astype(float)
    assert np.abs(ours - theirs).max() < 20
    assert len(match(first.descriptors, np.empty((0, 128), np.uint8))) == 0


def test_a_rig_on_an_arc_is_placed():
    features, truth = {}, {}
    for frame, (rotation, translation) in enumerate(arc(5)):
        for name, shift in (("left", (0.15, 0, 0)), ("right", (-0.15, 0, 0))):
            features[ViewId(frame, name)] = features_of(rotation, translation + shift, seed=frame)
            truth[ViewId(frame, name)] = (rotation, translation + shift)
    model = solve(PoseInputs(features, [["left", "right"]]), {"left": GUESS, "right": GUESS})
    assert any(rung.name == "rig_constraint" and rung.taken for rung in model.rungs)
    assert set(model.poses) == set(features)
    assert model.lenses["left"].fx == pytest.approx(FOCAL, rel=0.02)
    assert model.reprojection_px < 0.4
    # The rig is rigid: the second camera stands at one place beside the first, in every frame.
    apart = [
        model.poses[ViewId(frame, "right")].matrix()
        @ np.linalg.inv(model.poses[ViewId(frame, "left")].matrix())
        for frame in range(5)
    ]
    assert np.ptp(np.stack(apart), axis=0).max() < 1e-6
    assert apart[0] == pytest.approx(model.cam_from_rig["right"].matrix(), abs=1e-6)
    keys = sorted(features)
    first = keys[0]
    for key in keys:
        relative = model.poses[key].matrix() @ np.linalg.inv(model.poses[first].matrix())
        true = truth[key][0] @ truth[first][0].T
        angle = np.degrees(np.arccos(np.clip((np.trace(relative[:3, :3].T @ true) - 1) / 2, -1, 1)))
        assert angle < 0.15
    spread = centres([model.poses[key] for key in keys])
    true_spread = np.stack([-truth[key][0].T @ truth[key][1] for key in keys])
    distances = np.linalg.norm(spread[:, None] - spread, axis=-1)
    true_distances = np.linalg.norm(true_spread[:, None] - true_spread, axis=-1)
    scale = distances.sum() / true_distances.sum()
    assert distances / scale == pytest.approx(true_distances, abs=0.01 * true_distances.max())


def test_cameras_that_never_see_the_same_at_once_are_one_rig():
    """They look apart, along a wall: what one sees now, the other has seen or will see."""
    wall = RNG.uniform(-1, 1, (600, 3)) * (7.0, 1.2, 0.8) + (0.0, 0.0, 4.0)
    features, places = {}, np.linspace(-3.0, 3.0, 7)
    for frame, place in enumerate(places):
        for name, angle in (("left", 35.0), ("right", -35.0)):
            rotation = turned(angle)
            features[ViewId(frame, name)] = features_of(
                rotation,
                -rotation @ np.array([place, 0.02 * frame**2, 0.1 * np.sin(frame)]),
                seed=frame,
                scene=wall,
            )
    model = solve(PoseInputs(features, [["left", "right"]]), {"left": GUESS, "right": GUESS})
    for frame in range(len(places)):
        pairs = match(
            features[ViewId(frame, "left")].descriptors, features[ViewId(frame, "right")].descriptors
        )
        assert len(pairs) == 0
    assert set(model.poses) == set(features)
    assert any(rung.name == "rig_constraint" and rung.taken for rung in model.rungs)
    apart = model.cam_from_rig["right"].matrix()[:3, :3] @ model.cam_from_rig["left"].matrix()[:3, :3].T
    assert np.degrees(np.arccos((np.trace(apart) - 1) / 2)) == pytest.approx(70.0, abs=0.3)


@pytest.mark.parametrize(("k1", "views"), [(0.0, 5), (-0.12, 5), (0.0, 12), (-0.06, 12)])
def test_a_lens_is_bent_only_where_it_is(k1, views):
    """Five views tell of -0.06 by 0.6 to 3 standard errors only, as chance has it."""
    features = {ViewId(i, "cam"): features_of(*pose, seed=i, k1=k1) for i, pose in enumerate(arc(views))}
    model = solve(PoseInputs(features, focal_known={"cam"}), {"cam": GUESS})
    (rung,) = [rung for rung in model.rungs if rung.name == "lens_radial_1"]
    assert rung.taken == (k1 != 0)
    assert model.lenses["cam"].k1 == pytest.approx(k1, abs=0.01 if k1 else 0)
    assert model.lenses["cam"].fx == pytest.approx(FOCAL, rel=0.02)


def test_two_views_are_enough():
    features = {ViewId(i, "cam"): features_of(*pose, seed=i) for i, pose in enumerate(arc(4)[::3])}
    assert len(solve(PoseInputs(features, focal_known={"cam"}), {"cam": GUESS}).poses) == 2


def test_a_turn_is_told_from_a_flat_scene():
    x, y = np.meshgrid(np.linspace(-1, 1, 12), np.linspace(-0.8, 0.8, 12))
    flat = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], 1)
    ahead, size = np.array([0, 0, 4.0]), (WIDTH, HEIGHT)

    def picture(points, rotation, translation):
        points = points @ rotation.T + translation
        return FOCAL * points[:, :2] / points[:, 2:] + (WIDTH / 2, HEIGHT / 2)

    here = picture(flat, np.eye(3), ahead)
    assert (
        MatchedPair(here, picture(flat, turned(10), turned(10) @ ahead), NO_INDEX).parallax(size, 2.0) < 2e-3
    )
    assert MatchedPair(here, picture(flat, turned(10), ahead), NO_INDEX).parallax(size, 2.0) > 0.05
    deep = MatchedPair(picture(POINTS, np.eye(3), ahead), picture(POINTS, turned(24), ahead), NO_INDEX)
    assert deep.parallax(size, 2.0) == float("inf")


@pytest.mark.parametrize(
    ("features", "cause"),
    [
        ({ViewId(0, "cam"): features_of(*arc(1)[0])}, "Only one view"),
        (
            {ViewId(i, "cam"): Features(np.empty((0, 2)), np.empty((0, 128), np.uint8)) for i in range(4)},
            "without texture",
        ),
        (
            {ViewId(0, "cam"): features_of(*arc(1)[0]), ViewId(1, "cam"): Features(
                features_of(*arc(1)[0]).points, np.roll(features_of(*arc(1)[0]).descriptors, 64, axis=1))},
            "share enough",
        ),
    ],
)  # fmt: skip
def test_the_cause_is_named_when_nothing_can_be_placed(features, cause):
    with pytest.raises(CalibrationError, match=cause) as refused:
        solve(PoseInputs(features), {"cam": GUESS})
    assert "\n" not in str(refused.value)

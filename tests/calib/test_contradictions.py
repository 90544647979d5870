"""Scenes that look alike from several sides: views stand where they were, or are left out by name."""

import numpy as np
import pytest

from calib.features import Features
from calib.sfm import Model, solve
from imaging.calibration import Lens
from imaging.errors import CalibrationError

from .conftest import silent

Array = np.ndarray
WIDTH, HEIGHT, FOCAL = 320, 240, 300.0
LENS = Lens(
    model="SIMPLE_RADIAL", width=WIDTH, height=HEIGHT, fx=FOCAL, fy=FOCAL, cx=WIDTH / 2, cy=HEIGHT / 2
)
SIDES, VIEWS, POINTS = 2, 20, 450


def camera(view: int) -> Array:
    """cam_from_world [4, 4] of a camera on a ring about a pillar at the origin, now above it, now below."""
    turn, tilt = np.radians(360 / VIEWS * view), np.radians(12 * (-1) ** view)
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
        seen = rng.permutation(np.flatnonzero(facing))
        own = vectors.reshape(-1, 128)[seen] + 0.1 * rng.normal(size=(len(seen), 128))
        own /= np.linalg.norm(own, axis=1, keepdims=True)
        points = pixels[seen] + rng.normal(0, 0.2, (len(seen), 2))
        features["cam", view] = Features(points, own.astype(np.float32))
        brightness["cam", view] = light[seen] + rng.normal(0, 0.02, len(seen))
    return features, brightness, poses


def placed(alike: bool, lit: bool) -> tuple[Model, list[int]]:
    """The model, and the views of it that do not turn against their neighbours as they do in truth."""
    features, brightness, poses = pillar(alike, lit)
    model = solve(features, {"cam": LENS}, [], 1, silent, focal_known={"cam"}, brightness=brightness)
    found = {frame: pose.matrix()[:3, :3] for (_, frame), pose in model.poses.items()}
    worlds = {frame: poses[frame, :3, :3].T @ turn for frame, turn in found.items()}
    votes = {
        frame: sum(np.linalg.norm(own - other) < 0.05 for other in worlds.values())
        for frame, own in worlds.items()
    }
    best = max(votes, key=votes.__getitem__)
    return model, [frame for frame, own in worlds.items() if np.linalg.norm(own - worlds[best]) > 0.05]


def test_views_that_do_not_contradict_each_other_are_doubted_where_light_differs():
    """As of a crate whose corners are passed in steps that match nothing: one side stands before another."""
    features, brightness, _ = pillar(alike=False, lit=True)
    arc = {key: own for key, own in features.items() if key[1] < 8}
    darker = {key: brightness[key] - 0.5 * (key[1] % 2) for key in arc}
    for exact, doubted in ((["cam"], True), ([], False)):
        model = solve(arc, {"cam": LENS}, [], 1, silent, focal_known={"cam"}, brightness=darker, exact=exact)
        assert any(rung.name == "lit_differently" for rung in model.rungs) == doubted
    model = solve(
        arc, {"cam": LENS}, [], 1, silent, focal_known={"cam"}, brightness=brightness, exact=["cam"]
    )
    assert not any(rung.name == "lit_differently" for rung in model.rungs)


def rung(model: Model):
    return next(rung for rung in model.rungs if rung.name == "contradictions")


def test_all_views_of_a_pillar_that_is_unique_stay():
    model, wrong = placed(alike=False, lit=True)
    assert len(model.poses) == VIEWS
    assert wrong == []
    assert not model.contradicted
    assert not rung(model).taken


def test_light_tells_sides_apart_that_look_alike():
    model, wrong = placed(alike=True, lit=True)
    assert wrong == []
    assert len(model.poses) == VIEWS
    assert "lit differently" in rung(model).reason


def test_sides_that_nothing_tells_apart_are_refused():
    with pytest.raises(CalibrationError, match="parts of a scene look alike: put something unique"):
        placed(alike=True, lit=False)

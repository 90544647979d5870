"""The court: seen all round from one place, with a sun of known light and 18 stops below its lamp."""

import math

import numpy as np
import pytest

from drivers.sim.rigs import NODAL_BRACKET, simulate
from drivers.sim.scene.court import EYE, SUN, SUN_AT, SUN_RADIUS, court_scene


def test_the_head_turns_about_its_entrance_pupil_and_sees_everything() -> None:
    rig = simulate("nodal", 5)
    motions = [rig.cam_from_world(0, frame) for frame in range(rig.frames)]
    for motion in motions:
        np.testing.assert_allclose(-motion[:3, :3].T @ motion[:3, 3], EYE, atol=1e-12)
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(4000, 3))
    lens = rig.mounts[0].optics.lens
    shown = np.zeros(len(directions), int)
    for motion in motions:
        x, y, z = (directions @ motion[:3, :3].T).T
        angle = np.arctan2(np.hypot(x, y), z)
        radius = angle * (
            1 + lens.k1 * angle**2 + lens.k2 * angle**4 + lens.k3 * angle**6 + lens.k4 * angle**8
        )
        u, v = (lens.fx * radius * part / np.hypot(x, y) for part in (x, y))
        shown += (np.abs(u) < 158) & (np.abs(v) < 118) & (angle < 1.2)
    assert shown.min() >= 1
    assert (shown >= 2).mean() > 0.4


def test_the_sun_has_the_light_of_its_disc() -> None:
    height, turn = SUN_AT
    ahead = np.array([math.cos(height) * math.cos(turn), math.cos(height) * math.sin(turn), math.sin(height)])
    side = np.cross(ahead, (0.0, 0.0, 1.0)) / math.cos(height)
    scene = court_scene()
    for angle, inside in ((0.0, True), (0.98 * SUN_RADIUS, True), (1.02 * SUN_RADIUS, False)):
        light = scene.radiance(EYE, math.cos(angle) * ahead + math.sin(angle) * side)
        assert (light.min() == pytest.approx(SUN)) if inside else (light.max() < 1e4)


def test_the_shed_is_eighteen_stops_below_the_lamp_which_fits_into_the_shortest_exposure() -> None:
    rig = simulate("nodal", samples=1)
    green = np.stack([rig.radiance(0, frame)[..., 1] for frame in (1, 2, 5)])
    lamp = green.max()
    assert lamp * NODAL_BRACKET[0].time / 16 < 0.95
    assert np.log2(lamp / np.percentile(green, 0.05)) > 18

"""Falloff and sensitivities against what made the data."""

import re
from dataclasses import replace

import numpy as np
import pytest

from calib.light.falloff import Tracks
from calib.light.vignetting import estimate

NAMES = ["a", "b", "c", "d"]
MODELS = dict.fromkeys(NAMES, "one model")


def made(polynomials, gains, noise=0.05, outliers=0.1, points=1500, seed=0, floor=0.0):
    rng = np.random.default_rng(seed)
    brightness = rng.normal(0, 2, points)
    point = np.repeat(np.arange(points), 6)
    camera = rng.integers(0, 4, len(point))
    radius = rng.uniform(0, 1, len(point))
    falloff = 1 + (np.asarray(polynomials)[camera] * radius[:, None] ** np.array([2, 4, 6])).sum(1)
    falloff = np.maximum(falloff, floor)
    value = brightness[point] + np.log(falloff * np.asarray(gains)[camera]) + rng.normal(0, noise, len(point))
    wrong = rng.random(len(point)) < outliers
    value[wrong] += rng.normal(0, 1, int(wrong.sum()))
    return Tracks(point, camera, radius, value, towards(8.0 * np.tile(np.arange(6), points)), point % 20)


def towards(degrees):
    """Unit directions [N, 3] at these angles on an arc."""
    angle = np.radians(degrees)
    return np.stack([np.sin(angle), np.zeros_like(angle), np.cos(angle)], axis=1)


def taken(falloff):
    return {rung.name: rung.taken for rung in falloff.rungs}


def test_shared_falloff_and_gains_are_found_through_outliers():
    gains = np.array([0.98, 1.0, 1.03, 0.99])
    estimated = estimate(made([(-0.32, 0.09, -0.02)] * 4, gains), NAMES, MODELS)
    assert taken(estimated)["vignetting"]
    assert taken(estimated)["camera_gain"]
    relative = np.array([estimated.gain[name] for name in NAMES])
    assert relative / relative.mean() == pytest.approx(gains / gains.mean(), abs=0.004)
    radius = np.linspace(0, 1, 11)
    for name in NAMES:
        a, b, c = estimated.vignetting[name]
        value = 1 + a * radius**2 + b * radius**4 + c * radius**6
        truth = 1 - 0.32 * radius**2 + 0.09 * radius**4 - 0.02 * radius**6
        assert value == pytest.approx(truth, abs=0.012)


def test_cameras_that_differ_get_a_falloff_each():
    estimated = estimate(made([(-0.5, 0, 0), (-0.1, 0, 0), (-0.3, 0, 0), (0, 0, 0)], [1] * 4), NAMES, MODELS)
    assert taken(estimated)["vignetting_each_camera"]
    # Three powers of the radius for one model, then for four cameras; gains have no mean of their own.
    costs = {rung.name: rung.parameters for rung in estimated.rungs}
    assert costs.pop("vignetting_by_side") is None
    assert costs == {"vignetting": 3, "camera_gain": 3, "vignetting_each_camera": 9}
    corner = [1 + sum(estimated.vignetting[name]) for name in NAMES]
    assert corner == pytest.approx([0.5, 0.9, 0.7, 1.0], abs=0.03)


def test_nothing_is_modelled_where_nothing_is_there():
    """Allow one of forty rungs by chance; by one standard error, two would be taken."""
    by_chance = 0
    for seed in range(20):
        estimated = estimate(made(np.zeros((4, 3)), [1] * 4, seed=seed, points=300), NAMES, MODELS)
        by_chance += taken(estimated)["vignetting"] + taken(estimated)["camera_gain"]
        assert abs(sum(estimated.vignetting["a"])) < 0.02
    assert by_chance <= 1


def shining(seed, falloff, gain=0.0):
    """Points that are brightest from the front, where all cameras look; at each of 5 places there are two."""
    rng = np.random.default_rng(seed)
    points = 600
    point, place = (one.ravel() for one in np.indices((points, 10)))
    place, camera = place // 2, place % 2
    ahead = (place - 2) / 2
    radius = np.clip(0.15 + 0.5 * np.abs(ahead) + rng.uniform(-0.15, 0.35, len(point)), 0, 1)
    value = rng.normal(0, 2, points)[point] + rng.normal(0, 0.04, len(point))
    value += 0.25 * np.exp(-2 * ahead**2) + np.log(1 + falloff * radius**2) + gain * camera
    return Tracks(point, camera, radius, value, towards(15.0 * place + 4.0 * camera), point % 20)


@pytest.mark.parametrize("falloff", [0.0, -0.3])
def test_sheen_is_no_falloff(falloff):
    estimated = estimate(shining(1, falloff), NAMES[:2], MODELS)
    assert taken(estimated)["vignetting_by_side"]
    assert taken(estimated)["vignetting"] == (falloff != 0)
    powers = np.linspace(0, 1, 11)[:, None] ** [2, 4, 6]
    truth = 1 + falloff * powers[:, 0]
    assert 1 + powers @ estimated.vignetting["a"] == pytest.approx(truth, abs=0.04)
    # Without a thought of sides the sheen is taken for a lens, or makes one fall off more.
    one_side = estimate(replace(shining(1, falloff), direction=towards(np.zeros(6000))), NAMES[:2], MODELS)
    assert sum(one_side.vignetting["a"]) < falloff - 0.08


@pytest.mark.parametrize(("gain", "differ"), [(0.015, False), (0.06, True)])
def test_where_surfaces_shine_cameras_differ_if_they_do_by_more_than_sheen(gain, differ):
    """Views of one side see sheen that is not quite the same."""
    estimated = estimate(shining(1, 0.0, gain), NAMES[:2], MODELS)
    (rung,) = (rung for rung in estimated.rungs if rung.name == "camera_gain")
    assert rung.gain > 2 * rung.standard_error
    assert rung.taken == differ
    assert ("and sheen changes as much" in rung.reason) != differ
    assert estimated.gain["b"] / estimated.gain["a"] == pytest.approx(
        np.exp(gain) if differ else 1.0, abs=0.01
    )


def test_what_nobody_would_notice_is_left_out():
    estimated = estimate(
        made(np.zeros((4, 3)), [1.0, 1.004, 1.0, 1.002], noise=0.005, outliers=0), NAMES, MODELS
    )
    (rung,) = (rung for rung in estimated.rungs if rung.name == "camera_gain")
    assert not rung.taken
    assert rung.gain > 10 * rung.standard_error
    assert "would change no light by more than 0.2" in rung.reason
    assert set(estimated.gain.values()) == {1.0}


def test_unequal_cameras_are_no_falloff():
    """Place each camera's points at other radii, where either passes for the other."""
    tracks = made(np.zeros((4, 3)), [0.94, 1.0, 1.06, 1.0])
    radius = np.clip(
        0.25 * tracks.camera + np.random.default_rng(1).uniform(0, 0.3, len(tracks.camera)), 0, 1
    )
    assert [
        rung.name for rung in estimate(replace(tracks, radius=radius), NAMES, MODELS).rungs if rung.taken
    ] == ["camera_gain"]


def test_too_few_points_leave_it_open():
    estimated = estimate(made([(-0.32, 0.09, -0.02)] * 4, [1] * 4, points=50), NAMES, MODELS)
    assert estimated.vignetting["a"] == (0.0, 0.0, 0.0)
    assert "fewer than 100" in estimated.rungs[0].reason


def test_no_observations_at_all():
    empty = Tracks(
        np.empty(0, np.int64),
        np.empty(0, np.int64),
        *np.empty((2, 0)),
        np.empty((0, 3)),
        np.empty(0, np.int64),
    )
    assert estimate(empty, NAMES, MODELS).gain == dict.fromkeys(NAMES, 1.0)


@pytest.mark.parametrize("truth", [(-0.8, 0.0, 0.0), (-1.5, 1.2, -0.5), (-0.9, 0.0, 0.0)])
def test_corners_with_a_fifth_or_a_tenth_of_the_light_are_told_as_they_are(truth):
    estimated = estimate(made([truth] * 4, [1] * 4, points=600), NAMES, MODELS)
    powers = np.linspace(0, 1, 11)[:, None] ** [2, 4, 6]
    assert 1 + powers @ estimated.vignetting["a"] == pytest.approx(1 + powers @ truth, rel=0.01)


@pytest.mark.parametrize("truth", [(-0.98, 0.0, 0.0), (-1.1, 0.0, 0.0)])
def test_what_no_lens_does_is_refused_with_its_mend(truth):
    """Corners with a fiftieth of the light, and black ones."""
    gains = np.array([0.9, 1.0, 1.1, 1.0])
    estimated = estimate(made([truth] * 4, gains, points=600, floor=0.003), NAMES, MODELS)
    assert estimated.vignetting["a"] == (0.0, 0.0, 0.0)
    (rung,) = (rung for rung in estimated.rungs if rung.name == "vignetting")
    assert not rung.taken
    assert "less than 5 % of the light of the middle" in rung.reason
    assert rung.reason.endswith("mask what is dark, or shoot flats")


def test_cameras_behind_different_filters_get_no_gains_and_share_no_points():
    """One sees a band four times as bright as the others; that is the scene's colour, and no sensitivity."""
    tracks = made([(-0.3, 0.05, 0.0)] * 4, [1.0, 1.0, 1.0, 4.0], points=400)
    tracks = tracks.apart([0, 0, 0, 1])
    estimated = estimate(tracks, NAMES, MODELS, comparable=False)
    assert estimated.gain == dict.fromkeys(NAMES, 1.0)
    assert "camera_gain" not in taken(estimated)
    r = 0.8
    a, b, c = estimated.vignetting["d"]
    assert 1 + a * r**2 + b * r**4 + c * r**6 == pytest.approx(1 - 0.3 * r**2 + 0.05 * r**4, abs=0.03)


@pytest.mark.parametrize(
    "shape", [(-0.20, 0.20, 0.0), (0.15, 0.0, 0.0), (0.28, 0.66, -0.94), (-0.36, 0.44, -0.12)]
)
def test_what_goes_down_and_comes_back_or_rises_is_no_lens(shape):
    """Dark towards the middle of the way and bright again, brighter from the middle on, rise and fall."""
    estimated = estimate(made([shape] * 4, [1] * 4, points=1200, noise=0.03), NAMES, MODELS)
    a, b, c = estimated.vignetting["a"]
    r2 = np.linspace(0, 1, 101) ** 2
    light = 1 + a * r2 + b * r2**2 + c * r2**3
    assert np.diff(light).max() <= 1e-9
    # Nor is more taken away than the part of it that falls.
    true = 1 + shape[0] * r2 + shape[1] * r2**2 + shape[2] * r2**3
    assert light.min() >= min(true.min(), true[-1]) - 0.02


def test_regions_that_disagree_tell_of_no_lens():
    """Some regions grow darker outwards and some brighter, in thousands of points: surfaces, not glass."""
    tracks = made(np.zeros((4, 3)), [1] * 4, points=3000, noise=0.02, outliers=0)
    strength = np.random.default_rng(2).normal(-0.06, 0.15, 20)
    slope = strength[tracks.region] * tracks.radius**2
    estimated = estimate(replace(tracks, brightness=tracks.brightness + slope), NAMES, MODELS)
    (rung,) = (rung for rung in estimated.rungs if rung.name == "vignetting")
    assert not rung.taken
    assert estimated.vignetting["a"] == (0.0, 0.0, 0.0)


def test_a_falloff_smaller_than_what_one_scene_can_prove_is_left_out():
    estimated = estimate(made([(-0.015, 0, 0)] * 4, [1] * 4, noise=0.005, outliers=0), NAMES, MODELS)
    (rung,) = (rung for rung in estimated.rungs if rung.name == "vignetting")
    assert not rung.taken
    assert "would change no light by more than 1." in rung.reason


@pytest.mark.parametrize(("part", "rung"), [("falloff", "vignetting"), ("gain", "camera_gain")])
def test_parts_can_be_refused(part, rung):
    tracks = made([(-0.32, 0.09, -0.02)] * 4, [0.9, 1.0, 1.1, 1.0], points=600)
    estimated = estimate(tracks, NAMES, MODELS, without=[part])
    (refused,) = (one for one in estimated.rungs if one.name == rung)
    assert not refused.taken
    assert refused.reason == "left out, as was asked"
    assert (set(estimated.gain.values()) == {1.0}) == (part == "gain")
    assert (estimated.vignetting["a"] == (0.0, 0.0, 0.0)) == (part == "falloff")


def test_the_size_of_what_was_taken_is_said():
    estimated = estimate(made([(-0.32, 0.09, -0.02)] * 4, [0.9, 1.0, 1.1, 1.0], points=600), NAMES, MODELS)
    said = {rung.name: rung.reason for rung in estimated.rungs}
    # 1 - 0.32 + 0.09 - 0.02 is 0.75.
    assert re.search(r"model; the corners get 7[456] % of the light of the middle$", said["vignetting"])
    assert said["camera_gain"].endswith("cameras differ by up to 22 %")


@pytest.mark.parametrize(
    ("law", "expected"),
    [
        ({}, False),
        ({"a": -0.5}, False),
        (dict.fromkeys(NAMES, -0.5), True),
        (dict.fromkeys(NAMES, -2.0), False),
    ],
)
def test_two_standard_errors_are_enough_for_what_every_lens_does_to_raw(law, expected):
    """Without RAW of all cameras, or where lenses of this angle have much more, it takes three."""
    tracks = made([(-0.3, 0, 0)] * 4, [1] * 4, points=130, noise=0.35, seed=1)
    estimated = estimate(tracks, NAMES, MODELS, uncorrected=law)
    (rung,) = (rung for rung in estimated.rungs if rung.name == "vignetting")
    assert 2 < rung.gain / rung.standard_error < 3
    assert rung.taken == expected
    assert (sum(estimated.vignetting["a"]) < -0.1) == expected

"""Sensitivities of channels against what made the data."""

import numpy as np
import pytest

from calib.colour.white_balance import ColourObservations, estimate, folded

NAMES = ["a", "b", "c", "d"]
BASE = np.array([[0.72, 0.24, 0.04], [0.16, 0.72, 0.12], [0.03, 0.21, 0.76]])


def matrices(seed: int, spread: float) -> list[np.ndarray]:
    random = np.random.default_rng(seed)
    drawn = [BASE * np.exp(random.uniform(-spread, spread, (3, 3))) for _ in NAMES]
    return [one / one[1].sum() for one in drawn]


def made(
    channels: np.ndarray,
    matrices_of: list[np.ndarray],
    points: int = 1200,
    noise: float = 0.03,
    seed: int = 0,
) -> ColourObservations:
    """Colourful points of many brightnesses, each seen by four views, a tenth of them wrongly."""
    random = np.random.default_rng(seed)
    scene = np.exp(random.normal(0, 1.5, (points, 1)) + random.normal(0, 0.5, (points, 3)))
    point = np.repeat(np.arange(points), 4)
    camera = random.integers(0, 4, len(point))
    rgb = np.einsum("nij,nj->ni", np.array(matrices_of)[camera], scene[point]) * channels[camera]
    colour = np.log(rgb) + random.normal(0, noise, rgb.shape)
    wrong = random.random(len(point)) < 0.1
    colour[wrong] += random.normal(0, 1, (int(wrong.sum()), 3))
    return ColourObservations(point, camera, colour)


def logs(table: np.ndarray) -> np.ndarray:
    return np.log(table) - np.log(table).mean(axis=0)


CHANNELS = np.array([[1.08, 1.0, 0.93], [0.97, 1.02, 1.05], [1.0, 0.98, 1.0], [0.96, 1.0, 1.03]])


@pytest.mark.parametrize("spread", [0.0, 0.12])
def test_channels_are_found_through_outliers_whatever_the_matrices(spread: float) -> None:
    drawn = matrices(1, spread)
    balance = estimate(made(CHANNELS, drawn), NAMES, drawn)
    assert balance.rungs[0].taken
    table = np.array([balance.channels[name] for name in NAMES])
    errors = np.array([balance.errors[name] for name in NAMES])
    off = np.log(table) - logs(CHANNELS)
    assert np.abs(off).max() < 0.005
    assert np.log(table).mean(axis=0) == pytest.approx(np.zeros(3), abs=1e-9)
    # The errors that are stated are those that are made, on the whole.
    assert 0.5 < np.sqrt(np.mean((off / errors) ** 2)) < 2.0


def test_stated_errors_are_those_of_many_trials() -> None:
    drawn = matrices(2, 0.12)
    trials = [estimate(made(CHANNELS, drawn, points=300, seed=seed), NAMES, drawn) for seed in range(12)]
    off = [[np.log(one.channels[name]) for name in NAMES] - logs(CHANNELS) for one in trials]
    stated = [[one.errors[name] for name in NAMES] for one in trials]
    assert 0.7 < np.sqrt(np.mean((np.array(off) / np.array(stated)) ** 2)) < 1.4


def test_matrices_that_differ_are_not_taken_for_balance() -> None:
    for seed in range(5):
        drawn = matrices(seed, 0.12)
        balance = estimate(
            made(np.array([[1.1] * 3, [1.0] * 3, [0.9] * 3, [1.0] * 3]), drawn, seed=seed), NAMES, drawn
        )
        assert not balance.rungs[0].taken
        assert balance.channels == {}


def test_a_difference_too_small_to_be_told_from_the_scene_is_left_alone() -> None:
    """0.3 %, which many points show beyond doubt if each erred by itself; in a scene neighbours err alike."""
    drawn = matrices(1, 0.12)
    small = np.exp(np.array([[0.003, 0.0, -0.003], [-0.003, 0.0, 0.003], [0.0] * 3, [0.0] * 3]))
    balance = estimate(made(small, drawn, points=4000, noise=0.01), NAMES, drawn)
    (rung,) = balance.rungs
    assert rung.gain is not None
    assert rung.standard_error is not None
    assert rung.gain > rung.standard_error
    assert not rung.taken
    assert "no channel of a camera differs" in rung.reason


def test_the_white_of_anchors_stays() -> None:
    drawn = matrices(1, 0.1)
    balance = estimate(made(CHANNELS, drawn), NAMES, drawn, ["b"])
    assert balance.channels["b"] == pytest.approx((1, 1, 1))
    assert balance.errors["b"] == pytest.approx((0, 0, 0), abs=1e-9)
    assert balance.channels["a"] == pytest.approx(CHANNELS[0] / CHANNELS[1], rel=0.008)


def test_too_few_points_and_lonely_cameras_stay_as_they_are() -> None:
    drawn = matrices(1, 0.1)
    few = estimate(made(CHANNELS, drawn, points=50), NAMES, drawn)
    assert few.channels == {}
    assert "fewer than 100" in few.rungs[0].reason
    full = made(CHANNELS, drawn)
    without = full.part(full.camera != 3)
    balance = estimate(without, NAMES, drawn)
    assert set(balance.channels) == {"a", "b", "c"}
    relative = np.array([balance.channels[name] for name in "abc"])
    assert logs(relative) == pytest.approx(logs(CHANNELS[:3]), abs=0.006)
    empty = ColourObservations(np.empty(0, np.int64), np.empty(0, np.int64), np.empty((0, 3)))
    assert estimate(empty, NAMES, drawn).channels == {}


def test_folding_keeps_green_and_says_the_gain() -> None:
    matrix, balance, gain = folded(BASE / BASE[1].sum(), (1.1, 1.25, 1.0))
    assert matrix[1].sum() == pytest.approx(1.0)
    assert gain == 1.25
    assert balance == pytest.approx((0.88, 1.0, 0.8))
    assert gain * matrix == pytest.approx(np.array((1.1, 1.25, 1.0))[:, None] * BASE / BASE[1].sum())

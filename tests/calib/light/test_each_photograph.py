"""Exposure and white balance of each photograph against what made the data."""

import numpy as np
import pytest

from calib.light.each_photograph import Development, PhotographSights, estimate
from imaging.session.view_id import ViewId

VIEWS = [ViewId(frame, "cam") for frame in range(12)]


def sights(factors: np.ndarray, points: int = 600, noise: float = 0.04, seed: int = 0) -> PhotographSights:
    """Points of many colours, each in four photographs, a tenth of them mistaken for another."""
    rng = np.random.default_rng(seed)
    scene = rng.normal(0, 1.5, (points, 1)) + rng.normal(0, 0.5, (points, 3))
    point = np.repeat(np.arange(points), 4)
    view = np.concatenate([rng.choice(len(VIEWS), 4, replace=False) for _ in range(points)])
    colour = scene[point] + np.log(factors)[view] + rng.normal(0, noise, (len(point), 3))
    colour[rng.random(len(point)) < 0.1] += rng.normal(0, 1, 3)
    return PhotographSights(point, view, colour)


def drawn(exposure: float, balance: float, seed: int = 3) -> np.ndarray:
    """Factors [V, 3] that scatter by these standard deviations, natural log."""
    rng = np.random.default_rng(seed)
    logs = exposure * rng.standard_normal((len(VIEWS), 1)) + balance * rng.standard_normal((len(VIEWS), 3))
    return np.exp(logs - logs.mean(axis=0))


def factors_of(found: Development) -> np.ndarray:
    told = [found.exposure[view] * np.array(found.white_balance.get(view, (1, 1, 1))) for view in VIEWS]
    return np.array(told)


def taken(found: Development) -> list[bool]:
    return [rung.taken for rung in found.rungs]


def test_both_are_found_through_wrong_matches() -> None:
    factors = drawn(0.5, 0.15)
    found = estimate(sights(factors), VIEWS)
    assert taken(found) == [True, True]
    assert np.abs(np.log(factors_of(found) / factors)).max() < 0.015


def test_photographs_of_one_white_balance_get_an_exposure_alone() -> None:
    factors = drawn(0.3, 0.0)
    found = estimate(sights(factors), VIEWS)
    assert taken(found) == [True, False]
    assert found.white_balance == {}
    assert np.abs(np.log(factors_of(found) / factors)).max() < 0.015


def test_exposures_that_labels_tell_are_left_as_they_are() -> None:
    """White balance of luminance one changes no exposure by more than it has to."""
    logs = np.log(drawn(0.0, 0.2))
    factors = np.exp(logs - logs.mean(axis=1, keepdims=True))
    found = estimate(sights(factors), VIEWS)
    assert taken(found) == [False, True]
    assert np.abs(np.log(factors_of(found) / factors)).max() < 0.015


@pytest.mark.parametrize("spread", [0.0, 0.01])
def test_what_sheen_could_be_is_left_alone(spread: float) -> None:
    found = estimate(sights(drawn(spread, spread), noise=0.01), VIEWS)
    assert taken(found) == [False, False]
    assert found.exposure == {}


def test_few_points_tell_nothing() -> None:
    found = estimate(sights(drawn(0.5, 0.2), points=60), VIEWS)
    assert taken(found) == [False, False]
    assert "fewer than 100 points" in found.rungs[0].reason


def test_a_photograph_that_shares_little_stays_as_its_label_says() -> None:
    factors = drawn(0.5, 0.2)
    seen = sights(factors)
    few = seen.part((seen.view != 5) | (np.cumsum(seen.view == 5) < 20))
    found = estimate(few, VIEWS)
    assert VIEWS[5] not in found.exposure
    assert len(found.exposure) == len(VIEWS) - 1


def test_the_gain_of_a_camera_is_not_an_exposure_of_its_photographs() -> None:
    views = [ViewId(frame, "left" if frame < 6 else "right") for frame in range(12)]
    factors = np.repeat(np.where(np.arange(12) < 6, 1.3, 0.8)[:, None], 3, axis=1)
    assert taken(estimate(sights(factors), views)) == [False, False]

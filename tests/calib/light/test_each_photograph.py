"""Exposure and white balance of each photograph against what made the data."""

import re

import numpy as np
import pytest

from calib.light.constant_settings import Stated
from calib.light.each_photograph import Development, estimate
from calib.light.photograph_observations import PhotographObservations
from imaging.session.view_id import ViewId

VIEWS = [ViewId(frame, "cam") for frame in range(12)]


def observations(
    factors: np.ndarray, points: int = 600, noise: float = 0.04, seed: int = 0
) -> PhotographObservations:
    """Points of many colours, each in four photographs, a tenth of them mistaken for another."""
    rng = np.random.default_rng(seed)
    scene = rng.normal(0, 1.5, (points, 1)) + rng.normal(0, 0.5, (points, 3))
    point = np.repeat(np.arange(points), 4)
    view = np.concatenate([rng.choice(len(VIEWS), 4, replace=False) for _ in range(points)])
    colour = scene[point] + np.log(factors)[view] + rng.normal(0, noise, (len(point), 3))
    colour[rng.random(len(point)) < 0.1] += rng.normal(0, 1, 3)
    direction = np.tile([0.0, 0.0, 1.0], (len(point), 1))
    return PhotographObservations(point, view, colour, direction, point % 10)


def drawn(exposure: float, balance: float, seed: int = 3) -> np.ndarray:
    """Factors [V, 3] that scatter by these standard deviations, natural log."""
    rng = np.random.default_rng(seed)
    logs = exposure * rng.standard_normal((len(VIEWS), 1)) + balance * rng.standard_normal((len(VIEWS), 3))
    return np.exp(logs - logs.mean(axis=0))


def factors_of(development: Development) -> np.ndarray:
    factors = [
        development.exposure[view] * np.array(development.white_balance.get(view, (1, 1, 1)))
        for view in VIEWS
    ]
    return np.array(factors)


def taken(development: Development) -> list[bool]:
    return [rung.taken for rung in development.rungs]


def test_both_are_found_through_wrong_matches() -> None:
    factors = drawn(0.5, 0.15)
    estimated = estimate(observations(factors), VIEWS)
    assert taken(estimated) == [True, True]
    assert np.abs(np.log(factors_of(estimated) / factors)).max() < 0.015


def test_photographs_of_one_white_balance_get_an_exposure_alone() -> None:
    factors = drawn(0.3, 0.0)
    estimated = estimate(observations(factors), VIEWS)
    assert taken(estimated) == [True, False]
    assert estimated.white_balance == {}
    assert np.abs(np.log(factors_of(estimated) / factors)).max() < 0.015


def test_exposures_that_labels_tell_are_left_as_they_are() -> None:
    """White balance of luminance one changes no exposure by more than it has to."""
    logs = np.log(drawn(0.0, 0.2))
    factors = np.exp(logs - logs.mean(axis=1, keepdims=True))
    estimated = estimate(observations(factors), VIEWS)
    assert taken(estimated) == [False, True]
    assert np.abs(np.log(factors_of(estimated) / factors)).max() < 0.015


@pytest.mark.parametrize("spread", [0.0, 0.01])
def test_what_sheen_could_be_is_left_alone(spread: float) -> None:
    estimated = estimate(observations(drawn(spread, spread), noise=0.01), VIEWS)
    assert taken(estimated) == [False, False]
    assert estimated.exposure == {}


def test_few_points_tell_nothing() -> None:
    estimated = estimate(observations(drawn(0.5, 0.2), points=60), VIEWS)
    assert taken(estimated) == [False, False]
    assert "fewer than 100 points" in estimated.rungs[0].reason


def test_a_photograph_that_shares_little_stays_as_its_label_says() -> None:
    factors = drawn(0.5, 0.2)
    observed = observations(factors)
    few = observed.part((observed.view != 5) | (np.cumsum(observed.view == 5) < 20))
    estimated = estimate(few, VIEWS)
    assert VIEWS[5] not in estimated.exposure
    assert len(estimated.exposure) == len(VIEWS) - 1


def test_the_gain_of_a_camera_is_not_an_exposure_of_its_photographs() -> None:
    views = [ViewId(frame, "left" if frame < 6 else "right") for frame in range(12)]
    factors = np.repeat(np.where(np.arange(12) < 6, 1.3, 0.8)[:, None], 3, axis=1)
    assert taken(estimate(observations(factors), views)) == [False, False]


def shining(factors: np.ndarray, share: float, seed: int = 0) -> PhotographObservations:
    """A walk around regions of which a share reflect a warm lamp, each in its own direction and as much as it
    shines; the others are matt. Neighbouring views look from nearly the same side."""
    rng = np.random.default_rng(seed)
    points, regions, views = 800, 20, len(VIEWS)
    region = np.arange(points) % regions
    shiny = np.arange(regions) < share * regions
    away = 6.0 * np.arange(views)  # degrees
    towards = rng.uniform(0, away[-1], regions)
    strength = np.where(shiny, rng.uniform(0.3, 1.2, regions), 0.0)
    lobe = strength[:, None] * np.exp(-(((away - towards[:, None]) / 25.0) ** 2))
    lamp = np.log1p(lobe[..., None] * np.array([1.0, 0.8, 3.0]))
    scene = rng.normal(0, 1.0, (points, 1)) + rng.normal(0, 0.3, (points, 3))
    first = rng.integers(0, views - 3, points)
    point = np.repeat(np.arange(points), 4)
    view = (first[:, None] + np.arange(4)).ravel()
    colour = scene[point] + lamp[region[point], view] + np.log(factors)[view]
    colour += rng.normal(0, 0.03, colour.shape)
    angle = np.radians(away[view])
    direction = np.stack([np.sin(angle), np.zeros_like(angle), np.cos(angle)], axis=1)
    return PhotographObservations(point, view, colour, direction, region[point])


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("share", [0.6, 1.0])
def test_a_lamp_on_shiny_skin_is_no_white_balance(share: float, seed: int) -> None:
    estimated = estimate(shining(np.ones((12, 3)), share, seed), VIEWS)
    assert taken(estimated) == [False, False]
    assert estimated.exposure == estimated.white_balance == {}
    said = re.search(
        r"between photographs from one side (\d+) % as much as without", estimated.rungs[1].reason
    )
    assert said is not None
    assert int(said[1]) > 50


@pytest.mark.parametrize("seed", range(4))
def test_cameras_that_expose_and_balance_by_themselves_are_told_beside_a_lamp_on_skin(seed: int) -> None:
    factors = drawn(0.35, 0.12, seed)
    estimated = estimate(shining(factors, 0.3, seed), VIEWS)
    assert taken(estimated) == [True, True]
    off = np.log(factors_of(estimated) / factors)
    assert (off - off.mean(axis=0)).std() < 0.25 * np.log(factors).std()


SAID = {"cam": "the files say so"}


def asked_of(development: Development) -> np.ndarray:
    """Factors [V, 3] that are kept beside what the files state."""
    white = [development.white_balance_asked.get(view, (1, 1, 1)) for view in VIEWS]
    exposure = [development.exposure_asked.get(view, 1.0) for view in VIEWS]
    return np.array(exposure)[:, None] * np.array(white)


def test_what_files_say_is_the_same_stays_the_same_with_what_points_say_beside_it() -> None:
    factors = drawn(0.5, 0.15)
    both = estimate(observations(factors), VIEWS, Stated(SAID, SAID))
    assert taken(both) == [False, False]
    assert both.exposure == both.white_balance == {}
    assert np.abs(np.log(asked_of(both) / factors)).max() < 0.015
    size = np.log(factors).mean(axis=1).std()
    (percent,) = re.findall(r"so; by scene points they differ in brightness by (\d+) %", both.rungs[0].reason)
    assert int(percent) == pytest.approx(100 * size, abs=1)


@pytest.mark.parametrize("part", ["exposure", "white_balance"])
def test_one_part_that_files_state_is_kept_beside_the_other_that_is_taken(part: str) -> None:
    factors = drawn(0.5, 0.15)
    estimated = estimate(observations(factors), VIEWS, Stated(**{part: SAID}))
    assert taken(estimated) == [part != "exposure", part != "white_balance"]
    assert np.abs(np.log(asked_of(estimated) * factors_of(estimated) / factors)).max() < 0.015


@pytest.mark.parametrize("factors", [np.ones((12, 3)), drawn(0.01, 0.01)])
def test_nothing_is_kept_where_points_agree_with_the_files(factors: np.ndarray) -> None:
    estimated = estimate(observations(factors, noise=0.01), VIEWS, Stated(SAID, SAID))
    assert [rung.reason for rung in estimated.rungs] == ["the files say so"] * 2
    assert not estimated.differs


def test_sheen_is_not_kept_beside_what_files_say() -> None:
    assert not estimate(shining(np.ones((12, 3)), 0.6), VIEWS, Stated(SAID, SAID)).differs


def test_a_camera_whose_files_say_nothing_is_told_beside_one_whose_files_do() -> None:
    views = [ViewId(frame, "set" if frame < 6 else "auto") for frame in range(12)]
    factors = drawn(0.5, 0.0)
    factors[:6] = 1.0
    estimated = estimate(observations(factors), views, Stated({"set": "so"}, {"set": "so"}))
    assert taken(estimated) == [True, False]
    assert {estimated.exposure[view] for view in views[:6]} == {1.0}
    exposures = np.log([estimated.exposure[view] for view in views[6:]])
    true = np.log(factors[6:, 0])
    assert exposures == pytest.approx(true - true.mean(), abs=0.03)


@pytest.mark.parametrize(
    ("part", "expected"), [("exposure", [False, True]), ("white_balance", [True, False])]
)
def test_parts_can_be_refused(part: str, expected: list[bool]) -> None:
    estimated = estimate(observations(drawn(0.5, 0.15)), VIEWS, without=[part])
    assert taken(estimated) == expected
    assert sum(rung.reason == "left out, as was asked" for rung in estimated.rungs) == 1
    refused = estimate(observations(drawn(0.5, 0.15)), VIEWS, Stated(SAID, SAID), without=[part])
    assert (bool(refused.exposure_asked), bool(refused.white_balance_asked)) == tuple(expected)

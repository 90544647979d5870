"""Gain by harmonics of the direction, from samples of scene points."""

import numpy as np
import pytest
from torch import from_numpy

from imaging.files.colmap import read_tracks
from recon.data.geometry import lift
from recon.data.light import radiance_image
from recon.data.load import load
from recon.decide.steps.size import lowest
from recon.decide.steps.view_dependence import (
    CELLS,
    FEWEST_POINTS,
    FEWEST_VIEWS,
    RIDGE,
    Gains,
    Looks,
    _missed,
    gains,
    looks,
    uncovered,
)
from recon.scene.harmonics import basis

POINTS, VIEWS = 200, 16


def made(gloss: float = 0.0, bend: float = 0.0, noise: float = 0.02, views: int = VIEWS) -> Looks:
    """Points seen from all over a half sphere, each with light of its own.

    gloss: of log light that grows along an axis of the point's own; bend: with the square of that.
    """
    rng = np.random.Generator(np.random.PCG64(7))
    towards = rng.standard_normal((views, POINTS, 3))
    towards[..., 2] = np.abs(towards[..., 2]) + 0.2
    towards /= np.linalg.norm(towards, axis=-1, keepdims=True)
    axis = rng.standard_normal((POINTS, 3))
    along = np.einsum("vpk,pk->vp", towards, axis / np.linalg.norm(axis, axis=1, keepdims=True))
    light = rng.standard_normal(POINTS) + gloss * along + bend * along**2
    return Looks(light + noise * rng.standard_normal(along.shape), towards, np.full(along.shape, 0.1))


def chosen(looks: Looks) -> int:
    estimated = gains(looks)
    assert estimated is not None
    return lowest(estimated)


def test_matte_points_in_noise_need_no_direction():
    estimated = gains(made(noise=0.1))
    assert isinstance(estimated, Gains)
    assert estimated.points == POINTS
    assert (estimated.db[1:] < 0.1).all()
    assert lowest(estimated) == 0


@pytest.mark.parametrize(("gloss", "bend", "degree"), [(0.2, 0.0, 1), (0.0, 0.5, 2), (0.2, 0.5, 2)])
def test_gloss_needs_the_degree_it_has(gloss, bend, degree):
    assert chosen(made(gloss, bend)) == degree


def test_errors_shrink_with_more_points():
    whole = made(0.2)
    some = Looks(whole.light[:, :60], whole.towards[:, :60], whole.slope[:, :60])
    few, many = gains(some), gains(whole)
    assert 1.3 < few.error[0, 1] / many.error[0, 1] < 2.6
    assert many.error[0, 1] == many.error[1, 0] > 0


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_a_look_is_predicted_by_a_fit_to_all_others(degree):
    """Against ridge regressions that never saw the look; their constant is not held back."""
    looks = made(0.2, 0.3)
    light, towards = looks.light[:, 0].copy(), looks.towards[:, 0]
    light[[2, 5]] = np.nan
    there = np.flatnonzero(np.isfinite(light))
    columns = basis(from_numpy(towards), degree).numpy()
    columns[:, 0] = 1
    ridge = np.diag([0.0, *[RIDGE] * (columns.shape[1] - 1)])
    squares = []
    for omitted in there:
        rest = there[there != omitted]
        a = columns[rest]
        fit = np.linalg.solve(a.T @ a + ridge, a.T @ light[rest])
        squares.append((light[omitted] - columns[omitted] @ fit) ** 2)
    missed = _missed(light[None], towards[None], degree)
    np.testing.assert_allclose(missed, [np.mean(squares)], rtol=1e-9)


@pytest.mark.parametrize("short", ["views", "points"])
def test_too_few_looks_tell_nothing(short):
    looks = made(1.0)
    if short == "views":
        looks.light[FEWEST_VIEWS - 1 :] = np.nan
    else:
        looks.light[:, FEWEST_POINTS - 1 :] = np.nan
    assert gains(looks) is None


def test_looks_are_where_calibration_saw_a_point_and_light_is_a_number(toy):
    dataset = load(toy)
    images = [radiance_image(view) for view in dataset.train]
    _, tracks = read_tracks(toy / "calibration" / "colmap")
    before = looks(dataset, images)
    for row, view in enumerate(dataset.train):
        tracked = tracks[view.id.image_name]
        looked = np.flatnonzero(np.isfinite(before.light[row]))
        assert set(looked) <= set(tracked.tolist())
        assert len(looked) > len(tracked) / 2
    for bad in (0.0, np.nan, np.inf, -1.0):
        spoilt = [(rgb.copy(), trusted) for rgb, trusted in images]
        spoilt[0][0][:] = bad
        spoilt[1][0][:, :32] = bad  # half of it
        after = looks(dataset, spoilt)
        assert not np.isfinite(after.light[0]).any()
        assert 0 < np.isfinite(after.light[1]).sum() < np.isfinite(before.light[1]).sum()
        assert np.array_equal(after.light[2:], before.light[2:], equal_nan=True)
        assert not np.isinf(after.light).any()
        assert not np.isinf(after.slope).any()


def test_points_without_tracks_are_looked_at_where_nothing_stands_before_them(toy):
    dataset = load(toy)
    lens = dataset.train[0].lens
    pixels = np.stack(np.meshgrid(np.arange(2.5, lens.width, 2), np.arange(2.5, lens.height, 2)), -1)
    pixels = pixels.reshape(-1, 2)
    near, far = (lift(lens, pixels, np.full(len(pixels), depth)) for depth in (0.5, 1.0))
    half = pixels[:, 0] < lens.width / 2
    points = np.concatenate([near[half], far])
    outside = near[:1] + 100
    uncovered_points = uncovered(lens, points, np.concatenate([points, outside]))
    assert set(uncovered_points) >= set(range(half.sum()))
    rows = uncovered_points[uncovered_points >= half.sum()] - half.sum()
    # A cell of the border may count for both sides.
    assert pixels[rows, 0].min() > lens.width / 2 - 3 * lens.width / CELLS
    assert len(rows) > 0.9 * (~half).sum()
    assert len(points) not in uncovered_points


def test_points_without_tracks_tell_gloss_as_tracks_do(toy):
    dataset = load(toy)
    images = [radiance_image(view) for view in dataset.train]
    xyz, _ = dataset.tracks()
    tracked, given = looks(dataset, images), looks(dataset, images, xyz)
    assert given.light.shape == tracked.light.shape
    both = np.isfinite(tracked.light) & np.isfinite(given.light)
    assert both.sum() > 0.8 * np.isfinite(tracked.light).sum()
    assert np.array_equal(tracked.light[both], given.light[both])

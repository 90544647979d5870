"""Repeated frames against brute force, and frames whose light flickers."""

import numpy as np
import pytest

from calib.sensor.stack import gather, sites, tiles


def noise(count: int, side: int = 48) -> np.ndarray:
    rng = np.random.default_rng(1)
    pattern = rng.normal(0, 3, (side, side))
    return np.rint(500 + pattern + rng.normal(0, 6, (count, side, side))).astype(np.uint16)


def test_mean_variance_and_halves_are_those_of_the_frames() -> None:
    frames = noise(7)
    stack = gather(iter(frames), 0.5, None)
    level = frames.mean(axis=(1, 2), keepdims=True)
    even = frames - level + level[0]
    np.testing.assert_allclose(stack.mean, frames.mean(axis=0), atol=1e-3)
    np.testing.assert_allclose(stack.halves[0], frames[::2].mean(axis=0), atol=1e-3)
    np.testing.assert_allclose(stack.halves[1], frames[1::2].mean(axis=0), atol=1e-3)
    np.testing.assert_allclose(stack.variance, even.var(axis=0, ddof=1), rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(stack.levels, [sites(f).mean(axis=(1, 2)) for f in frames], rtol=1e-12)
    assert (stack.frames, stack.time) == (7, 0.5)
    assert stack.rows[0] < 4 * stack.rows[1]


def test_flicker_does_not_pass_for_noise() -> None:
    rng = np.random.default_rng(2)
    light = 100.0 + rng.poisson(2000.0 * np.array([1.0, 0.9, 1.1, 1.0, 0.95])[:, None, None], (5, 64, 64))
    stack = gather(light.astype(np.uint16), 1.0, 100.0)
    assert stack.variance.mean() == pytest.approx(2000.0 * 0.99, rel=0.04)


def test_tiles_leave_out_what_is_not_usable() -> None:
    frames = noise(3)
    usable = np.ones(frames.shape[1:], bool)
    usable[::7, ::5] = False
    frames[:, ~usable] = 4000
    cut = tiles(gather(frames, 1.0), usable)
    assert len(cut.mean) == 4 * 3 * 3
    assert np.all(np.abs(cut.mean - 500) < 4)
    assert cut.count.sum() == usable.sum()


def test_frames_of_unlike_size_and_none_at_all() -> None:
    with pytest.raises(ValueError, match="one size"):
        gather([np.zeros((4, 4), np.uint16), np.zeros((4, 6), np.uint16)], 1.0)
    with pytest.raises(ValueError, match="one frame or more"):
        gather([], 1.0)
    one = gather([np.full((4, 4), 9, np.uint16)], 1.0)
    assert np.array_equal(one.halves[0], one.halves[1])
    assert not one.variance.any()

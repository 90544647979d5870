"""Brightness of a view around its features."""

import numpy as np

from calib.light.tracks import LUMINANCE, brightness_at, light
from imaging.merge.bracket import Merged


def test_a_wide_picture_is_looked_at_in_a_reduced_one() -> None:
    """A ramp with noise, one place unknown; the truth is the ramp."""
    rng = np.random.default_rng(0)
    height, width = 80, 4001
    ramp = np.linspace(0.1, 0.4, width) * np.linspace(1, 1.1, height)[:, None]
    truth = ramp[..., None] * (1.0, 0.8, 0.5)
    radiance = (truth * (1 + 0.2 * rng.standard_normal(truth.shape))).astype(np.float32)
    valid = np.ones(radiance.shape, bool)
    radiance[40, 2000, 1], valid[40, 2000, 1] = np.nan, False
    sigma = (0.2 * truth).astype(np.float32)
    sigma[40, 2000, 1] = np.nan
    none = np.zeros(radiance.shape, bool)
    reduced = light(Merged(radiance, sigma, valid, none, none), None)
    assert reduced.luminance.shape == (40, 2000)
    points = np.stack(np.meshgrid(np.arange(10.5, 1590, 10), np.arange(4.5, 28, 5)), axis=-1).reshape(-1, 2)
    brightness = brightness_at(reduced, points, 1600, 32)
    x, y = (points * (width / 1600, height / 32)).T
    true = np.log(truth[y.astype(int), x.astype(int)] @ LUMINANCE)
    away = np.maximum(np.abs(x - 2000), np.abs(y - 40))
    assert (away < 5).any()
    assert np.isnan(brightness[away < 5]).all()
    far = away > 14
    assert np.isfinite(brightness[far]).all()
    # Twelve px each way: 0.2 of each is 0.017 of their mean, less for three channels.
    assert np.abs(brightness[far] - true[far]).std() < 0.02
    assert abs(np.mean(brightness[far] - true[far])) < 0.005
    # Where light is hardly above its noise nothing is trusted, reduced or not.
    noisy = light(Merged(radiance, 10 * sigma, valid, none, none), None)
    assert not noisy.trusted.any()

"""Huber's weight and loss against their definition, and the scale of normal residuals."""

import numpy as np
import pytest

from imaging.robust import huber_loss, huber_weight, robust_scale

SIZES = np.array([0.0, 0.5, 1.0, 2.0, 10.0])


def test_residuals_within_the_limit_count_in_full_and_others_by_their_size() -> None:
    np.testing.assert_allclose(huber_weight(-SIZES, 1.0), [1, 1, 1, 0.5, 0.1])
    np.testing.assert_allclose(huber_loss(-SIZES, 1.0), [0, 0.125, 0.5, 1.5, 9.5])


@pytest.mark.parametrize("limit", [0.3, 2.5])
def test_weights_are_the_slope_of_the_loss_over_the_residual(limit: float) -> None:
    at, step = SIZES[1:] + 0.01, 1e-6
    slope = (huber_loss(at + step, limit) - huber_loss(at - step, limit)) / (2 * step)
    np.testing.assert_allclose(huber_weight(at, limit), slope / at, rtol=1e-6)


def test_the_scale_of_normal_residuals_is_their_deviation_and_outliers_move_it_little() -> None:
    residual = np.random.default_rng(0).normal(0, 3.0, 20_000)
    assert robust_scale(residual) == pytest.approx(3.0, rel=0.02)
    residual[:200] = 1e6
    assert robust_scale(residual) == pytest.approx(3.0, rel=0.04)

"""Losses against numpy and finite differences."""

import numpy as np
import pytest
import torch

from imaging import metrics
from recon.observe.losses.photometric import Photometric, mu_law


@pytest.mark.parametrize("mu", [500.0, 5000.0])
def test_mu_law_is_that_of_the_metrics_and_odd(mu):
    signal = torch.tensor([-1.0, -3e-4, -2e-4, 0.0, 1e-6, 0.1, 1.0, 50.0], dtype=torch.float64)
    np.testing.assert_allclose(mu_law(signal, mu).numpy(), metrics.mu_law(signal.numpy(), mu=mu), rtol=1e-12)
    assert torch.equal(mu_law(-signal, mu), -mu_law(signal, mu))


def test_mu_law_has_the_right_slope_everywhere_even_at_zero():
    signal = torch.tensor([-0.5, -2e-4, 0.0, 3e-5, 0.7, 20.0], dtype=torch.float64, requires_grad=True)
    mu_law(signal, 500.0).sum().backward()
    step = 1e-9
    with torch.no_grad():
        slope = (mu_law(signal + step, 500.0) - mu_law(signal - step, 500.0)) / (2 * step)
    np.testing.assert_allclose(signal.grad.numpy(), slope.numpy(), rtol=1e-4)


@pytest.mark.parametrize("weight", [0.0, 0.2, 0.8])
def test_photometric_gradient_is_the_finite_difference(weight):
    generator = torch.Generator().manual_seed(7)
    target = torch.rand(2, 16, 18, generator=generator)
    prediction = (target + 0.2 * torch.randn(2, 16, 18, generator=generator)).requires_grad_(True)
    loss = Photometric(weight)
    loss(prediction, target).backward()
    direction = torch.randn(prediction.shape, generator=generator)
    step = 2e-3
    with torch.no_grad():
        high, low = (loss(prediction + sign * step * direction, target) for sign in (1, -1))
    difference = float(high - low) / (2 * step)
    assert float((prediction.grad * direction).sum()) == pytest.approx(difference, rel=0.02)


def test_photometric_is_zero_for_equal_images_and_weighs_its_parts():
    generator = torch.Generator().manual_seed(8)
    target = torch.rand(3, 32, 32, generator=generator)
    other = torch.rand(3, 32, 32, generator=generator)
    assert float(Photometric(0.2)(target, target)) == pytest.approx(0, abs=1e-6)
    near, likeness = (float(Photometric(weight)(other, target)) for weight in (0.0, 1.0))
    assert near == pytest.approx(float((other - target).abs().mean()), rel=1e-6)
    assert float(Photometric(0.2)(other, target)) == pytest.approx(0.8 * near + 0.2 * likeness, rel=1e-5)

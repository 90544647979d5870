"""The learned tone curve: monotone whatever its parameters, continuous at its ends, right at its start."""

import numpy as np
import pytest
import torch

from imaging.calibration import Response
from recon.photographs import ToneCurve
from recon.tone import encode
from recon.tone_grid import (
    LEAK,
    Grid,
    apply_curve,
    curve_parameters,
    curve_values,
    middle_of,
    remap_rate,
    roughness,
    sampled,
)

SRGB = Response(kind="srgb", evidence="test")
NODES = torch.from_numpy(Grid().nodes())


def test_remap_of_the_published_example():
    rate = remap_rate([1 / 8, 2, 32])
    assert rate == pytest.approx(0.7213, abs=1e-4)
    assert np.diff(rate * np.log([1 / 8, 2, 32])) == pytest.approx([2, 2])


def test_remap_survives_one_exposure_and_hundreds():
    assert remap_rate([0.1]) == 1.0
    assert 0.25 <= remap_rate(list(np.geomspace(0.01, 1, 300))) <= 2.0
    assert remap_rate([1.0, 1.0001, 2.0**12]) == 0.25


@pytest.mark.parametrize("scale", [0.1, 1.0, 30.0, 1000.0])
def test_curve_rises_from_zero_to_one_whatever_its_parameters(scale):
    theta = scale * torch.randn(2, 3, len(NODES) - 1, generator=torch.Generator().manual_seed(5))
    values = curve_values(theta)
    assert torch.isfinite(values).all()
    assert (values[..., 1:] >= values[..., :-1]).all()
    assert values[..., 0].eq(0).all()
    np.testing.assert_allclose(values[..., -1], 1.0, rtol=1e-6)


def test_parameters_of_values_give_the_values_back():
    values = np.sort(np.random.default_rng(1).uniform(0, 1, (3, 200)), axis=1)
    values[:, 0], values[:, -1] = 0.0, 1.0
    np.testing.assert_allclose(curve_values(curve_parameters(values)), values, atol=2e-4)


def test_leaky_ends_are_continuous_with_the_published_slopes():
    values = torch.linspace(0, 1, len(NODES), dtype=torch.float64)
    low, high = float(NODES[0]), float(NODES[-1])
    x = torch.tensor(
        [low - 1e-9, low + 1e-9, high - 1e-9, high + 1e-9, low - 3, high + 1e6], dtype=torch.float64
    )
    x.requires_grad_(True)
    found = apply_curve(x, values, NODES, leaky=True)
    np.testing.assert_allclose(found.detach()[:5], [0, 0, 1, 1, -3 * LEAK], atol=1e-8)
    assert float(found[5].detach()) == pytest.approx(1 + LEAK, abs=1e-4)
    found.sum().backward()
    assert torch.isfinite(x.grad).all()
    assert float(x.grad[0]) == pytest.approx(LEAK)
    assert float(x.grad[3]) == pytest.approx(LEAK / 2, rel=1e-6)
    closed = apply_curve(x.detach(), values, NODES, leaky=False)
    assert closed.min() >= 0
    assert closed.max() <= 1


def test_curve_gradient_is_the_finite_difference():
    generator = torch.Generator().manual_seed(2)
    theta = torch.randn(3, len(NODES) - 1, generator=generator, dtype=torch.float64).requires_grad_(True)
    x = (8 * torch.randn(400, generator=generator, dtype=torch.float64)).requires_grad_(True)

    def loss(parameters, places):
        return apply_curve(places, curve_values(parameters)[1], NODES, leaky=True).square().sum()

    loss(theta, x).backward()
    for value, moved in ((theta, lambda step: (theta + step, x)), (x, lambda step: (theta, x + step))):
        step = 1e-6 * torch.randn(value.shape, generator=generator, dtype=torch.float64)
        with torch.no_grad():
            difference = float(loss(*moved(step)) - loss(*moved(-step))) / 2
        assert float((value.grad * step).sum()) == pytest.approx(difference, rel=1e-4)


def test_roughness_of_a_parabola_is_its_bend_squared_on_the_uneven_grid():
    assert float(roughness(0.5 * 3.0 * NODES**2, NODES)) == pytest.approx(9.0, rel=0.02)
    assert float(roughness(2 * NODES + 1, NODES)) == pytest.approx(0.0, abs=1e-15)


def test_grid_is_twice_as_dense_in_its_core_and_covers_what_it_must():
    steps = np.diff(Grid().nodes())
    assert steps.max() == pytest.approx(1 / 64)
    assert steps.min() == pytest.approx(1 / 128)
    wide = Grid().covering(-20.0, 9.0).nodes()
    assert wide[0] == -20.0
    assert wide[-1] == 9.0


def test_the_start_is_the_response_of_the_calibration():
    rate, middle = 0.7, middle_of(SRGB)
    nodes = Grid().nodes()
    curve = ToneCurve(
        normaliser=1.0,
        nodes=torch.from_numpy(nodes.astype(np.float32)),
        theta=sampled(SRGB, nodes, rate, middle)[None],
        of_camera={"cam": 0},
        rate=rate,
        middle=middle,
        epsilon=1e-9,
    )
    light = np.geomspace(0.003, 0.95, 50)
    expected = encode(light[:, None].repeat(3, 1), SRGB)
    np.testing.assert_allclose(curve.codes_of(np.log(light)), expected, atol=0.03)

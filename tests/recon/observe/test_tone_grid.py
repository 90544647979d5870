"""The learned tone curve: monotone whatever its parameters, continuous at its ends, right at its start."""

import numpy as np
import pytest
import torch

import imaging.compute.threads as threads
from imaging.session.calibration import Response
from recon.data.tone import encode
from recon.observe.photographs import ToneCurve
from recon.observe.tone_grid import (
    EXACT,
    LEAK,
    apply_curve,
    curve_parameters,
    curve_values,
    grid_nodes,
    middle_of,
    needed,
    remap_rate,
    roughness,
    sampled,
)

SRGB = Response(kind="srgb", evidence="test")
NODES = torch.from_numpy(grid_nodes())


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
    mapped = apply_curve(x, values, NODES, leaky=True)
    np.testing.assert_allclose(mapped.detach()[:5], [0, 0, 1, 1, -3 * LEAK], atol=1e-8)
    assert float(mapped[5].detach()) == pytest.approx(1 + LEAK, abs=1e-4)
    mapped.sum().backward()
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


def test_grid_is_twice_as_dense_in_its_core():
    steps = np.diff(grid_nodes())
    assert steps.max() == pytest.approx(1 / 64)
    assert steps.min() == pytest.approx(1 / 128)


def test_the_start_is_the_response_of_the_calibration():
    rate, middle = 0.7, middle_of(SRGB)
    nodes = grid_nodes()
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


@pytest.mark.parametrize("shape", [(7,), (3, 50, 41), (2, 130, 270), (0,)])
def test_the_kernel_does_what_plain_operations_do(shape):
    """Values and both gradients, against float64 by autograd: inside, outside, and on the nodes."""
    rng = np.random.default_rng(1)
    nodes = torch.from_numpy(grid_nodes().astype(np.float32))
    values = curve_values(torch.from_numpy(rng.normal(size=len(nodes) - 1).astype(np.float32)))
    x = torch.from_numpy(rng.uniform(-14, 9, shape).astype(np.float32))
    some = nodes[::3][: x.numel()]
    x.view(-1)[: len(some)] = some
    outer = torch.from_numpy(rng.normal(size=shape))
    results = []
    for dtype in (torch.float32, torch.float64):
        a, b = (tensor.detach().clone().to(dtype).requires_grad_() for tensor in (x, values))
        result = apply_curve(a, b, nodes.to(dtype), leaky=True)
        (result * outer.to(dtype)).sum().backward()
        results.append([result.detach().double(), a.grad.double(), b.grad.double()])
    inside = (x > nodes[0]) & (x < nodes[-1]) & ~torch.isin(x, nodes)  # on a node there are two slopes
    torch.testing.assert_close(results[0][0], results[1][0], rtol=1e-5, atol=1e-6)
    torch.testing.assert_close(results[0][1][inside], results[1][1][inside], rtol=1e-3, atol=1e-6)
    outside = (x < nodes[0]) | (x > nodes[-1])
    torch.testing.assert_close(results[0][1][outside], results[1][1][outside], rtol=1e-4, atol=1e-7)
    torch.testing.assert_close(results[0][2], results[1][2], rtol=1e-4, atol=1e-4)


def test_the_kernel_finds_the_interval_of_every_node_and_of_its_neighbours():
    """Grids of any spacing, from cells that hold many nodes to nodes that span many cells."""
    rng = np.random.default_rng(8)
    for count, power in ((2, 1), (3, 1), (50, 12), (1441, 1), (3000, 6)):
        nodes = np.unique(np.sort(rng.uniform(0, 1, count) ** power * 15 - 10).astype(np.float32))
        values = torch.linspace(0, 1, len(nodes)).square()
        x = np.concatenate([nodes, np.nextafter(nodes, -99), np.nextafter(nodes, 99), [np.nan]])
        x = torch.from_numpy(x.astype(np.float32))
        mapped = apply_curve(x, values, torch.from_numpy(nodes), leaky=True)
        expected = apply_curve(x.double(), values.double(), torch.from_numpy(nodes).double(), leaky=True)
        torch.testing.assert_close(mapped[:-1].double(), expected[:-1], atol=2e-6, rtol=0)
        assert mapped[-1].isnan()


def test_the_kernel_gives_the_same_bits_on_any_number_of_threads():
    nodes = torch.from_numpy(grid_nodes().astype(np.float32))
    before, results = threads.thread_count(), []
    try:
        for count in (1, 2, 3):
            threads.set_threads(count)
            generator = torch.Generator().manual_seed(0)
            x = (torch.rand(200_000, generator=generator) * 20 - 12).requires_grad_()
            values = curve_values(torch.zeros(len(nodes) - 1)).requires_grad_()
            apply_curve(x, values, nodes, leaky=True).square().sum().backward()
            results.append((x.grad.numpy().tobytes(), values.grad.numpy().tobytes()))
    finally:
        threads.set_threads(before)
    assert results[0] == results[1] == results[2]


def test_nodes_that_a_curve_needs_hold_it_everywhere():
    nodes = grid_nodes()
    curves = np.stack([1 / (1 + np.exp(-nodes / rate)) for rate in (0.5, 1.0, 2.0)])
    curves[1] = np.minimum(curves[1], 0.8)
    chosen = needed(nodes, curves)
    assert (chosen[0], chosen[-1]) == (0, len(nodes) - 1)
    lines = np.stack([np.interp(nodes, nodes[chosen], curve[chosen]) for curve in curves])
    assert np.abs(lines - curves).max() <= EXACT
    assert len(chosen) < 100


def test_a_straight_line_needs_its_ends_and_noise_everything():
    nodes = grid_nodes()
    assert needed(nodes, nodes[None] / 15).tolist() == [0, len(nodes) - 1]
    noise = np.cumsum(np.random.default_rng(3).uniform(0, 0.1, (2, len(nodes))), axis=1)
    assert len(needed(nodes, noise)) > 0.9 * len(nodes)

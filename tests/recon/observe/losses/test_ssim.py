"""The fused L1 and SSIM against plain torch in float64, finite differences and `imaging.metrics`."""

from collections.abc import Callable

import numpy as np
import pytest
import torch
import torch.nn.functional as F

import imaging.compute.threads as threads
from imaging import metrics
from imaging.metrics import ssim_taps
from recon.observe.losses.dense_ssim import dense_photometric_loss
from recon.observe.losses.ssim import photometric_loss
from tests.recon.launches import Launches

Loss = Callable[[torch.Tensor, torch.Tensor, float], torch.Tensor]
on_each_device = pytest.mark.parametrize("loss", [photometric_loss, dense_photometric_loss])
"""The operations of a GPU run on the CPU, too."""
SHAPES = [(3, 48, 64), (1, 1, 1), (2, 7, 5), (4, 17, 3), (1, 130, 67), (2, 64, 16), (1, 65, 33), (2, 3, 90)]


def ssim_map(x: torch.Tensor, y: torch.Tensor) -> torch.Tensor:
    """Compute by the textbook, with zeros outside, in float64."""
    taps = torch.tensor(ssim_taps())
    weights = (taps[:, None] * taps)[None, None]

    def mean(image: torch.Tensor) -> torch.Tensor:
        return F.conv2d(image[:, None], weights, padding=5)[:, 0]

    mx, my = mean(x), mean(y)
    vx, vy, both = mean(x * x) - mx**2, mean(y * y) - my**2, mean(x * y) - mx * my
    top = (2 * mx * my + 0.01**2) * (2 * both + 0.03**2)
    return top / ((mx**2 + my**2 + 0.01**2) * (vx + vy + 0.03**2))


def pair(shape: tuple[int, int, int], seed: int = 0) -> tuple[torch.Tensor, torch.Tensor]:
    rng = np.random.default_rng(seed)
    y = rng.uniform(0, 1, shape)
    x = np.clip(y + 0.1 * rng.normal(size=shape), 0, 1)
    return torch.tensor(x, dtype=torch.float32), torch.tensor(y, dtype=torch.float32)


@on_each_device
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("weight", [0.0, 0.2, 1.0])
def test_value_and_gradient_equal_torch(loss: Loss, shape: tuple[int, int, int], weight: float) -> None:
    x, y = pair(shape)
    ours, theirs = x.clone().requires_grad_(), x.double().requires_grad_()
    value = loss(ours, y, weight)
    expected = (1 - weight) * (theirs - y.double()).abs().mean()
    expected = expected + weight * (1 - ssim_map(theirs, y.double()).mean())
    assert value.item() == pytest.approx(expected.item(), abs=1e-6)
    (3 * value).backward()
    (3 * expected).backward()
    assert (ours.grad.double() - theirs.grad).norm() <= 1e-5 * theirs.grad.norm()


def test_few_operations_launch_kernels_on_a_gpu() -> None:
    x, y = pair((3, 48, 64))
    dense_photometric_loss(x, y, 0.3)  # the window is sent once
    x.requires_grad_()
    with Launches() as launches:
        dense_photometric_loss(x, y, 0.3).backward()
    assert 0 < launches.count <= 36


def test_gradient_equals_finite_differences() -> None:
    x, y = pair((2, 20, 18))
    x.requires_grad_()
    photometric_loss(x, y, 1.0).backward()
    direction = torch.tensor(np.random.default_rng(3).normal(size=x.shape))
    step = 1e-5
    with torch.no_grad():
        ends = [1 - ssim_map(x.double() + s * step * direction, y.double()).mean() for s in (1, -1)]
    slope = ((ends[0] - ends[1]) / (2 * step)).item()
    assert (x.grad * direction).sum().item() == pytest.approx(slope, rel=1e-5)


def test_interior_equals_the_metric() -> None:
    x, y = pair((1, 40, 52), 5)
    inner = ssim_map(x.double(), y.double())[0, 5:-5, 5:-5].mean().item()
    assert metrics.ssim(x[0].numpy(), y[0].numpy()) == pytest.approx(inner, abs=1e-9)


@on_each_device
@pytest.mark.parametrize("level", [0.0, 1e-3, 0.5, 1.0, 100.0])
def test_constant_planes_are_finite(loss: Loss, level: float) -> None:
    for other in (level, 0.0, 1.0):
        x = torch.full((2, 30, 21), level, requires_grad=True)
        value = loss(x, torch.full((2, 30, 21), other), 0.8)
        value.backward()
        assert torch.isfinite(value)
        assert torch.isfinite(x.grad).all()
        if other == level:
            assert abs(value.item()) < 1e-4
            assert x.grad.abs().max() < 1e-4


@on_each_device
def test_equal_planes_have_no_loss_and_no_gradient(loss: Loss) -> None:
    x, _ = pair((3, 33, 47))
    x.requires_grad_()
    value = loss(x, x.detach().clone(), 0.2)
    value.backward()
    assert value.item() == pytest.approx(0, abs=1e-6)
    assert x.grad.abs().max() < 1e-7


def test_thread_count_changes_no_bit() -> None:
    x, y = pair((3, 200, 150))
    before, results = threads.thread_count(), []
    try:
        for count in (1, 2, 3):
            threads.set_threads(count)
            leaf = x.clone().requires_grad_()
            value = photometric_loss(leaf, y, 0.2)
            value.backward()
            results.append((value.item(), leaf.grad.numpy().tobytes()))
    finally:
        threads.set_threads(before)
    assert results[0] == results[1] == results[2]


def test_strided_planes_and_no_gradient() -> None:
    x, y = pair((3, 24, 30))
    wide = torch.stack([x, y], dim=-1)
    with torch.no_grad():
        assert photometric_loss(wide[..., 0], wide[..., 1], 1.0).item() == photometric_loss(x, y, 1.0).item()
    assert not photometric_loss(x, y, 1.0).requires_grad


def test_wrong_planes_are_named() -> None:
    x, y = pair((3, 24, 30))
    with pytest.raises(ValueError, match="target has shape"):
        photometric_loss(x, y[:2], 1.0)
    with pytest.raises(ValueError, match="prediction has shape"):
        photometric_loss(x[0], y[0], 1.0)
    with pytest.raises(ValueError, match="float32 on one device"):
        photometric_loss(x.double(), y.double(), 1.0)

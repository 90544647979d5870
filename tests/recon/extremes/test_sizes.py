"""Images and scenes of any size, down to nothing."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from recon.splat import Limits, SplatCamera, rasterize

NAMES = ("means", "quats", "scales", "opacities", "colours", "background")


@pytest.mark.parametrize("size", [(1, 1), (1, 40), (17, 3), (16, 16), (33, 1), (4096, 16)])
@pytest.mark.parametrize("count", [0, 1, 25])
def test_size_equals_the_oracle(scene_of: Any, size: tuple[int, int], count: int) -> None:
    """Image and gradients; the centre of the scene is the centre of any image."""
    width, height = size
    scene = scene_of("background")
    for name in NAMES[:5]:
        setattr(scene, name, getattr(scene, name)[:count])
    camera = scene.camera
    scene.camera = replace(
        camera, width=width, height=height, fx=max(20.0, 0.5 * width), cx=width / 2, cy=height / 2
    )
    results = []
    for dtype in (torch.float32, torch.float64):
        tensors = scene.tensors(dtype)
        render = scene.render(tensors)
        assert render.image.shape == (height, width, 3)
        assert render.alpha.shape == (height, width)
        weights = torch.linspace(0.5, 1.5, render.image.numel(), dtype=dtype).reshape(render.image.shape)
        (render.image * weights).sum().backward()
        results.append((render, [torch.zeros_like(t) if t.grad is None else t.grad for t in tensors]))
    (ours, grads), (truth, expected) = results
    error = (ours.image.double() - truth.image).abs().detach()
    assert error.mean() < 1e-6
    assert count < 25 or truth.alpha.max() > 0
    for name, a, b in zip(NAMES, grads, expected, strict=True):
        assert torch.isfinite(a).all(), name
        assert (a - b).norm() <= 1e-3 * b.norm(), name


def test_a_million_gaussians_in_a_long_image() -> None:
    n = 1_000_000
    rng = np.random.default_rng(0)
    camera = SplatCamera(np.eye(4), fx=3000, fy=3000, cx=2048, cy=8, width=4096, height=16)
    means = np.stack([rng.uniform(-0.7, 0.7, n), rng.uniform(-0.01, 0.01, n), rng.uniform(0.9, 1.1, n)], 1)
    tensors = [
        torch.tensor(means, dtype=torch.float32),
        torch.tensor([[1.0, 0, 0, 0]]).expand(n, 4).contiguous(),
        torch.full((n, 3), 3e-4),
        torch.full((n,), 0.1),
        torch.full((n, 3), 0.5).requires_grad_(),
    ]
    render = rasterize(*tensors, camera)
    assert render.image.shape == (16, 4096, 3)
    # Every colour is 0.5, so the image is 0.5 alpha whatever the order.
    torch.testing.assert_close(render.image[..., 0], 0.5 * render.alpha, rtol=1e-4, atol=1e-5)
    assert render.alpha[8].mean() > 0.5
    render.image.sum().backward()
    # The image is linear in the colours: their slopes add up to it.
    assert float(0.5 * tensors[4].grad.double().sum()) == pytest.approx(
        float(render.image.detach().sum()), rel=1e-4
    )


def test_a_million_gaussians_in_one_pixel() -> None:
    """All in one list: alpha and the slopes of all opacities from the product of a million factors.

    The image is a float32 sum, to which layers add nothing that are 2^-25 of it: here all behind a
    transmittance of 2^-9.
    """
    n, opacity = 1_000_000, 2.0**-16
    camera = SplatCamera(np.eye(4), fx=10, fy=10, cx=0.5, cy=0.5, width=1, height=1)
    means = torch.zeros(n, 3)
    means[:, 2] = torch.linspace(1, 3, n)
    tensors = [
        means,
        torch.tensor([[1.0, 0, 0, 0]]).expand(n, 4).contiguous(),
        torch.full((n, 3), 0.01),
        torch.full((n,), opacity).requires_grad_(),
        torch.ones(n, 3),
    ]
    render = rasterize(*tensors, camera, limits=Limits(alpha_min=2.0**-20))
    through = np.exp(n * np.log1p(-opacity))
    assert render.visible == n
    assert float(render.alpha[0, 0].detach()) == pytest.approx(1 - through, rel=1e-6)
    assert float(render.image[0, 0, 0].detach()) == pytest.approx(1 - through, rel=2.0**-9)
    render.alpha[0, 0].backward()
    np.testing.assert_allclose(tensors[3].grad, through / (1 - opacity), rtol=1e-2)


def test_camera_inside_a_gaussian(scene_of: Any) -> None:
    """It is drawn if its centre is beyond the near plane, left out if not; both as the oracle does."""
    for depth in (-2.995, -2.98, -2.0):
        scene = scene_of("inside")
        scene.means[0] = torch.tensor([0.0, 0.0, depth]).float().double()
        results = []
        for dtype in (torch.float32, torch.float64):
            tensors = scene.tensors(dtype)
            render = scene.render(tensors)
            render.image.sum().backward()
            results.append((render.image.detach().double(), [tensor.grad for tensor in tensors]))
        (ours, grads), (truth, expected) = results
        assert (ours - truth).abs().mean() < 1e-6
        for name, a, b in zip(NAMES, grads, expected, strict=True):
            assert (a - b).norm() <= 1e-3 * b.norm(), (depth, name)
        assert bool(grads[0][0].any()) == (depth > -2.99)


def test_all_behind_is_the_background(scene_of: Any, dtype: torch.dtype) -> None:
    scene = scene_of("behind")
    tensors = scene.tensors(dtype)
    render = scene.render(tensors)
    assert torch.equal(render.image, tensors[5].expand(render.image.shape))
    assert not render.alpha.any()
    assert (render.visible, render.culled) == (0, 0)
    render.image.sum().backward()
    assert all(tensor.grad is None or not tensor.grad.any() for tensor in tensors[:5])
    assert (tensors[5].grad == render.alpha.numel()).all()

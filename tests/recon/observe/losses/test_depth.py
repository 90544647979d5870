"""The term of measured depth: its value for known surfaces, and its gradient by finite differences."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from recon.observe.losses.depth import SURE, MeasuredDepth
from recon.scene.appearance import LuminanceChromaticity
from recon.scene.gaussians import Gaussians, Renderer, limits_for
from recon.splat import SplatCamera

POSE = np.eye(4)
POSE[:3, 3] = 0.1, -0.05, 0.3
LENS = SplatCamera(POSE, 22.0, 21.0, 9.5, 8.2, 20, 16, k1=-0.05)


def scene(dtype: torch.dtype, count: int = 12) -> Gaussians:
    rng = np.random.default_rng(5)
    means = rng.uniform((-0.4, -0.3, 0.6), (0.4, 0.3, 1.4), (count, 3))
    quats = rng.normal(size=(count, 4))
    light = torch.from_numpy(rng.uniform(0.05, 2.0, (count, 3)).astype(np.float32))
    geometry = {
        "means": torch.from_numpy(means),
        "log_scales": torch.from_numpy(np.log(rng.uniform(0.1, 0.25, (count, 3)))),
        "quats": torch.from_numpy(quats),
        "opacity_logits": torch.from_numpy(rng.uniform(0.5, 3.0, count)),
    }
    every = geometry | LuminanceChromaticity().start(light)
    return Gaussians({name: value.to(dtype) for name, value in every.items()})


def measured(depth: np.ndarray) -> SimpleNamespace:
    stand_in = SimpleNamespace(read=lambda view: depth.astype(np.float32))
    lens = SimpleNamespace(width=depth.shape[1])
    return SimpleNamespace(name="0000/cam0", held=True, lens=lens, depth=stand_in)


def card(distance: float) -> Gaussians:
    """One opaque Gaussian across the whole picture."""
    geometry = {
        "means": torch.tensor([[0.0, 0.0, distance]]),
        "log_scales": torch.tensor([[3.0, 3.0, -6.0]]),
        "quats": torch.tensor([[1.0, 0, 0, 0]]),
        "opacity_logits": torch.tensor([9.0]),
    }
    return Gaussians(geometry | LuminanceChromaticity().start(torch.ones(1, 3)))


@pytest.mark.parametrize("reference", [None, 2.0**-20, 1e-3])
def test_a_wall_is_where_it_is_in_whatever_light(reference):
    render = Renderer(LuminanceChromaticity(), limits_for(reference))(card(1.7), LENS, degree=0, depth=True)
    away = (render.ln_depth / render.alpha).exp()
    np.testing.assert_allclose(away.numpy(), 2.0, rtol=1e-4)
    off = MeasuredDepth().difference(render, measured(np.full((16, 20), 2.0 * np.exp(0.3))))
    assert float(off) == pytest.approx(0.3 - SURE / 2, rel=1e-3)
    unknown = np.full((16, 20), 2.0)
    unknown[:, 10:] = 0
    assert float(MeasuredDepth().difference(render, measured(unknown))) < 1e-3
    nothing = MeasuredDepth().difference(render, measured(np.zeros((16, 20))))
    assert float(nothing) == 0


def test_light_is_drawn_as_without_depth():
    renderer, gaussians = Renderer(LuminanceChromaticity(), limits_for(1e-3)), scene(torch.float32, 60)
    plain = renderer(gaussians, LENS, degree=0)
    deep = renderer(gaussians, LENS, degree=0, depth=True)
    assert plain.ln_depth is None
    assert deep.image.shape == plain.image.shape
    np.testing.assert_allclose(deep.image.numpy(), plain.image.numpy(), rtol=1e-5, atol=1e-7)
    torch.testing.assert_close(deep.alpha, plain.alpha)


def test_a_render_of_its_own_has_the_same_depth(monkeypatch):
    """Use the path of GPUs, and of light with the most channels."""
    renderer, results = Renderer(LuminanceChromaticity(), limits_for(1e-3)), []
    for most in (16, 3):
        monkeypatch.setattr("recon.scene.gaussians.CHANNELS_MOST", most)
        gaussians = scene(torch.float32, 60)
        gaussians.parameters["means"].requires_grad_(True)
        render = renderer(gaussians, LENS, degree=0, depth=True)
        render.ln_depth.sum().backward()
        results.append((render.image.detach(), render.ln_depth.detach(), gaussians.parameters["means"].grad))
    for one, other in zip(*results, strict=True):
        torch.testing.assert_close(one, other, rtol=1e-4, atol=1e-5)


def test_its_gradient_is_that_of_finite_differences():
    gaussians, renderer = scene(torch.float64), Renderer(LuminanceChromaticity(), limits_for(1e-3))
    depth = np.random.default_rng(6).uniform(0.9, 1.8, (16, 20))
    depth[3:6, 4:9] = 0
    view, term = measured(depth), MeasuredDepth()

    def value() -> torch.Tensor:
        return term.difference(renderer(gaussians, LENS, degree=0, depth=True), view)

    parameters = {name: gaussians.parameters[name] for name in ("means", "log_scales", "opacity_logits")}
    for tensor in parameters.values():
        tensor.requires_grad_(True)
    value().backward()
    assert float(value().detach()) > 0.05
    rng = np.random.default_rng(7)
    for name, tensor in parameters.items():
        assert float(tensor.grad.abs().max()) > 1e-4
        for place in rng.choice(tensor.numel(), 8, replace=False):
            flat, step, both = tensor.data.view(-1), 1e-6, []
            for sign in (1, -1):
                flat[place] += sign * step
                with torch.no_grad():
                    both.append(float(value()))
                flat[place] -= sign * step
            gradient = float(tensor.grad.view(-1)[place])
            assert gradient == pytest.approx((both[0] - both[1]) / (2 * step), rel=1e-3, abs=1e-6), name


def test_float32_kernels_have_the_gradient_of_the_float64_reference():
    grads = []
    for dtype in (torch.float32, torch.float64):
        gaussians, renderer = scene(dtype), Renderer(LuminanceChromaticity(), limits_for(1e-3))
        gaussians.parameters["means"].requires_grad_(True)
        render = renderer(gaussians, LENS, degree=0, depth=True)
        MeasuredDepth().difference(render, measured(np.full((16, 20), 1.2))).backward()
        grads.append(gaussians.parameters["means"].grad.double())
    torch.testing.assert_close(grads[0], grads[1], rtol=2e-3, atol=1e-5)

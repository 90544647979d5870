"""High contrast, bad values and degenerate shapes in the Triton kernels."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from recon.splat import Limits, Render, SplatCamera
from recon.splat.raster_types import RasterInputs

pytest.importorskip("triton", reason="Triton is for Linux")

import triton
import triton.language as tl

from recon.splat.gpu import rasterize_gpu
from recon.splat.gpu.composite import cover

CAMERA = SplatCamera(np.eye(4), fx=20, fy=20, cx=12, cy=9, width=24, height=18)


def sheets(
    device: str, depths: list[float], opacities: list[float], light: list[float], limits: Limits
) -> Render:
    """Gaussians so wide that the image sees them as planes of one opacity."""
    n = len(depths)
    means = torch.tensor([[0.0, 0.0, z] for z in depths], device=device)
    quats = torch.tensor([[1.0, 0, 0, 0]] * n, device=device)
    scales = torch.tensor([[1e6, 1e6, 1e-3]] * n, device=device)
    colours = torch.tensor([[x] * 3 for x in light], device=device)
    opaque = torch.tensor(opacities, device=device)
    return rasterize_gpu(RasterInputs(means, quats, scales, opaque, colours, CAMERA, None, limits, None))


@pytest.mark.parametrize("contrast", [2.0**12, 2.0**20])
@pytest.mark.parametrize(("layers", "opacity"), [(1, 1.0), (2, 1.0 - 2.0**-14), (40, 0.6)])
def test_bright_plane_does_not_leak_through_a_card(
    device: str, contrast: float, layers: int, opacity: float
) -> None:
    depths = [*(2.0 + 0.01 * i for i in range(layers)), 9.0]
    limits = Limits.for_scene(1.0, contrast)
    light = [*[1.0] * layers, contrast]
    render = sheets(device, depths, [*[opacity] * layers, 1.0], light, limits)
    assert (render.image - 1).abs().max() < 0.01


def test_usual_constants_do_leak(device: str) -> None:
    """The test above can fail: with the cut-offs of 8-bit colour the card is lost."""
    render = sheets(device, [2.0, 9.0], [1.0, 1.0], [1.0, 2.0**12], Limits.gsplat())
    assert (render.image - 1).abs().max() > 1


def test_nearly_opaque_layer_leaks_what_it_should(device: str) -> None:
    """1 - alpha keeps its digits: an opacity of 1 - 2^-22 lets 2^-22 through, not 2^-22 +- 2^-24."""
    render = sheets(device, [2.0, 9.0], [1 - 2.0**-22, 1.0], [0.0, 2.0**22], Limits())
    assert (render.image - 1).abs().max() < 1e-4


def test_layer_that_crosses_the_cut_off_counts(device: str) -> None:
    render = sheets(device, [2.0, 3.0, 4.0], [0.5, 0.999, 0.9], [1.0, 3.0, 1e6], Limits(t_min=1e-2))
    assert (render.image / (0.5 + 0.5 * 0.999 * 3.0) - 1).abs().max() < 1e-5
    assert (render.alpha - (1 - 0.5 * 0.001)).abs().max() < 1e-6


@triton.jit
def _alphas(whitened, opacity, out, through, SIZE: tl.constexpr):
    i = tl.arange(0, SIZE)
    zero = tl.zeros([SIZE], tl.float32)
    ellipse = (zero, tl.load(whitened + i), zero, zero, zero, zero - 60.0, tl.load(opacity))
    _, alpha, rest = cover(ellipse, zero, zero, zero + 1.0, 0.0)
    tl.store(out + i, alpha)
    tl.store(through + i, rest)


@pytest.mark.parametrize("opacity", [1.0, 1 - 2.0**-24, 0.999, 0.5, 1e-6])
def test_alpha_and_its_complement_keep_their_digits(device: str, opacity: float) -> None:
    """Pins the rounding of the exponential: a reordered sum would make it wrong by whole powers of two."""
    whitened = np.concatenate([np.linspace(0, 7.7, 2048), np.geomspace(1e-5, 1, 2048)]).astype(np.float32)
    opacity = float(np.float32(opacity))
    out, through = torch.empty(2, len(whitened), device=device)
    _alphas[(1,)](
        torch.from_numpy(whitened).to(device), torch.full((1,), opacity, device=device), out, through,
        SIZE=len(whitened),
    )  # fmt: skip
    t = -(whitened * whitened).astype(np.float64)
    np.testing.assert_allclose(out.cpu(), opacity * np.exp2(t), rtol=4e-7)
    complement = (1 - opacity) - opacity * np.expm1(t * math.log(2))
    np.testing.assert_allclose(through.cpu(), complement, rtol=1.5e-6, atol=0)
    assert out.max() <= 1


@pytest.mark.parametrize("power", [-20, 1])
def test_radiance_scales_exactly(scene_of: Any, device: str, power: int) -> None:
    scene = scene_of("bright").smaller(12)
    scene.background = torch.tensor([0.25, 3.0, 1e-3]).double()
    render = scene.render_on(device, scene.tensors(torch.float32, grad=False))
    factor = 2.0**power
    scene.colours, scene.background = scene.colours * factor, scene.background * factor
    scene.limits = replace(scene.limits, luminance_reference=1e-6 * factor)
    scaled = scene.render_on(device, scene.tensors(torch.float32, grad=False))
    assert render.image.any()
    assert torch.equal(scaled.alpha, render.alpha)
    assert torch.equal(scaled.image, render.image * factor)


BAD = [math.nan, math.inf, -math.inf]
POISON = {
    "means": ([], [3e38, -3e38, 1e-45]),
    "quats": ([1e-45, 1e-30, 0.0], [3e38, 1e-18]),
    "scales": ([0.0, -1.0, 1e19, 3e38], [1e-45, 1e-30]),
    "opacities": ([-0.5], [0.0, 1e-45, 1.0, 1.5, 3e38, 1.0 / 255.0]),
    "colours": ([3e38, -3e30], [1e29, -1.0, 1e-45]),
}
"""Values that are culled besides those that are not finite, and values that are not."""


@pytest.mark.parametrize("field", list(POISON))
def test_poison_is_culled_and_counted(scene_of: Any, device: str, field: str) -> None:
    culled, drawn = POISON[field]
    values = [*BAD, *culled, *drawn]
    scene = scene_of("plain").smaller(len(values) + 4)
    scene.camera = replace(scene.camera, width=12, height=10, cx=6.0, cy=5.0)
    scene.means[: len(values)] = torch.tensor([0.1, 0.05, 0.0]).double()  # in the middle of the image
    getattr(scene, field)[: len(values)] = (
        torch.tensor(values).float().double().reshape(-1, *[1] * (getattr(scene, field).dim() - 1))
    )
    tensors = scene.tensors(torch.float32)
    render = scene.render_on(device, tensors)
    bad = len(BAD) + len(culled)
    assert render.culled == bad
    assert torch.isfinite(render.image).all()
    render.image.clamp(max=1e6).sum().backward()
    assert all(torch.isfinite(t.grad).all() for t in tensors)
    assert not any(t.grad[:bad].any() for t in tensors)
    without = scene.render_on(device, [t.detach()[bad:] for t in tensors])
    assert without.culled == 0
    assert torch.equal(without.image, render.image)


def test_one_bad_number_is_enough(scene_of: Any, device: str) -> None:
    scene = scene_of("plain").smaller(14)
    tensors = scene.tensors(torch.float32, grad=False)
    row = 0
    for tensor in tensors:
        for column in range(tensor[0].numel()):
            tensor[row].view(-1)[column] = math.nan
            row += 1
    assert row == 14
    render = scene.render_on(device, tensors)
    assert (render.culled, render.visible, render.pairs) == (14, 0, 0)
    assert not render.image.any()


@pytest.mark.filterwarnings("ignore:.*encountered in:RuntimeWarning")  # NumPy's, in the interpreter
def test_an_overflow_stays_in_its_tile(device: str) -> None:
    """Lists lie one behind the other, and a list's last chunk reaches into the next."""
    means = torch.tensor([[-0.7, -0.5, 2.0], [0.8, -0.5, 2.0]])
    quats, scales = torch.tensor([[1.0, 0, 0, 0]]).repeat(2, 1), torch.full((2, 3), 0.05)
    opacities, colours = torch.full((2,), 0.5), torch.tensor([[1.0] * 3, [1e30] * 3])
    gradients = []
    for count in (1, 2):
        tensors = [t[:count].to(device).requires_grad_() for t in (means, quats, scales, opacities, colours)]
        render = rasterize_gpu(RasterInputs(*tensors, CAMERA, None, Limits(), None))
        assert render.visible == count
        (render.image * 1e9).sum().backward()
        gradients.append([t.grad[0] for t in tensors])
    assert all(torch.equal(*pair) for pair in zip(*gradients, strict=True))
    assert all(torch.isfinite(gradient).all() for gradient in gradients[1])


@pytest.mark.parametrize("length", [1e3, 1e7])
def test_gradients_of_needles_do_not_cancel(scene_of: Any, device: str, length: float) -> None:
    scene = scene_of("needles").smaller(6)
    scene.scales[:] = torch.tensor([length, length * 1e-9, length * 1e-9]).float().double()
    fast, truth = scene.tensors(torch.float32), scene.tensors(torch.float64)
    scene.render_on(device, fast).image.square().sum().backward()
    scene.render(truth).image.square().sum().backward()
    for ours, theirs in zip(fast, truth, strict=True):
        assert (ours.grad - theirs.grad).norm() < 1e-3 * theirs.grad.norm()


def test_degenerate_needles(scene_of: Any, device: str) -> None:
    scene = scene_of("needles").smaller(6)
    scene.scales[:, 0] = torch.tensor([1e3, 1e4, 1e5, 1e6, 1e7, 1e10])
    scene.scales[:, 1] = scene.scales[:, 0] * 1e-9
    tensors = scene.tensors(torch.float32)
    render, truth = scene.render_on(device, tensors), scene.render(scene.tensors(torch.float64))
    assert render.culled == truth.culled > 0
    assert (render.image.cpu().double() - truth.image).abs().median() < 1e-4
    render.image.sum().backward()
    assert all(torch.isfinite(t.grad).all() for t in tensors)


def test_nothing_is_folded_back_into_the_image(device: str) -> None:
    """Beyond the radius where distortion stops growing, the polynomial would put Gaussians in the image."""
    camera = replace(CAMERA, k1=-0.5)
    for tangent, visible in ((1.2, 0), (0.3, 1)):
        tensors = [
            torch.tensor([[2 * tangent, 0.0, 2.0]], device=device),
            torch.tensor([[1.0, 0.0, 0.0, 0.0]], device=device),
            torch.full((1, 3), 0.05, device=device),
            torch.full((1,), 0.9, device=device),
            torch.ones(1, 3, device=device),
        ]
        render = rasterize_gpu(RasterInputs(*tensors, camera, None, Limits(), None))
        assert (render.visible, render.culled) == (visible, 0)
        assert bool(render.image.any()) == bool(visible)


def test_opacity_above_the_largest_alpha_keeps_its_gradient(scene_of: Any, device: str) -> None:
    scene = scene_of("plain").smaller(8)
    scene.limits = replace(scene.limits, alpha_max=0.75)
    scene.opacities[3:6] = torch.tensor([0.75, 0.9, 1.5])
    results = []
    for opacities in (scene.opacities, scene.opacities.clamp(max=0.75)):
        scene.opacities = opacities
        tensors = scene.tensors(torch.float32)
        render = scene.render_on(device, tensors)
        render.image.sum().backward()
        results.append((render.image.detach(), tensors[3].grad))
    assert torch.equal(results[0][0], results[1][0])
    assert torch.equal(results[0][1], results[1][1])
    assert results[0][1][3:6].any()

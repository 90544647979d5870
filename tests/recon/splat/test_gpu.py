"""The Triton rasteriser against the dense float64 oracle with the same cut-offs, and against the CPU kernels.

On a CUDA GPU where there is one, else through Triton's interpreter: slow, hence the smaller scenes.
"""

import math
import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

import recon.splat as splat
from imaging.errors import ReconstructionError
from recon.splat import Limits, Render, SplatCamera, SplatStats, rasterize

pytest.importorskip("triton", reason="Triton is for Linux")

import triton
import triton.language as tl

from recon.splat.gpu import rasterize_gpu
from recon.splat.gpu.composite import cover

NAMES = ("means", "quats", "scales", "opacities", "colours")
CAMERA = SplatCamera(np.eye(4), fx=20, fy=20, cx=12, cy=9, width=24, height=18)
SCENES = [
    "plain", "background", "lens", "strong lens", "bright", "big", "needles", "near lens", "opaque",
    "same place", "3dgs", "1x1", "17x3", "none", "one", "behind", "inside",
]  # fmt: skip


@pytest.fixture
def device() -> str:
    return "cuda" if torch.cuda.is_available() else "cpu"


def smaller(scene: Any, count: int = 14) -> Any:
    """Its first Gaussians, in a picture at most 20 pixels wide."""
    for name in NAMES:
        setattr(scene, name, getattr(scene, name)[:count])
    factor, old = min(1.0, 20 / scene.camera.width), scene.camera
    sizes = {name: factor * getattr(old, name) for name in ("fx", "fy", "cx", "cy")}
    scene.camera = replace(
        old, width=math.ceil(factor * old.width), height=math.ceil(factor * old.height), **sizes
    )
    return scene


def render_on(
    device: str, scene: Any, tensors: list[torch.Tensor], stats: SplatStats | None = None
) -> Render:
    """Through the GPU's kernels; the tensors stay where they are, and get their gradients."""
    moved = [tensor.to(device) for tensor in tensors]
    background = moved[5] if len(moved) > 5 else None
    return rasterize_gpu(*moved[:5], scene.camera, background, scene.limits, stats)


def loss(render: Render, seed: int = 0) -> torch.Tensor:
    """A smooth function of image and alpha, with another gradient at every pixel."""
    rng = np.random.default_rng(seed)
    a, b = (torch.tensor(rng.normal(size=tuple(x.shape))) for x in (render.image, render.alpha))
    return (a * torch.log1p(render.image.cpu().double())).sum() + (b * render.alpha.cpu().double()).sum()


@pytest.mark.parametrize("name", SCENES)
def test_equals_oracle(scene_of: Any, device: str, name: str) -> None:
    """Image, alpha, counts, gradients and statistics."""
    scene = smaller(scene_of(name))
    count = len(scene.means)
    fast, truth = scene.tensors(torch.float32), scene.tensors(torch.float64)
    ours, theirs = SplatStats(count), SplatStats(count)
    render, expected = render_on(device, scene, fast, ours), scene.render(truth, theirs)
    assert (render.image.device.type, render.image.dtype) == (device, torch.float32)
    same_image(render, expected, scene.camera)
    loss(render).backward()
    loss(expected).backward()
    for a, b, what in zip(fast, truth, (*NAMES, "background"), strict=False):
        same_gradient(a.grad, b.grad, what)
    assert np.array_equal(ours.seen, theirs.seen)
    for what in ("gradient", "radius", "weight"):
        a, b = getattr(ours, what), getattr(theirs, what)
        assert np.linalg.norm(a - b) <= 1e-4 * np.linalg.norm(b), what


def same_image(render: Render, expected: Render, camera: SplatCamera) -> None:
    image, truth = render.image.detach().cpu().double(), expected.image.detach()
    error = ((image - truth).abs() / (truth.abs() + 1e-6 * truth.abs().max() + 1e-30)).flatten()
    # A pixel at the very edge of a Gaussian may fall on either side of a cut-off; hence no maximum.
    assert error.mean() < 1e-5
    assert torch.quantile(error, 0.99) < 1e-5
    assert (render.alpha.cpu().double() - expected.alpha).abs().mean() < 1e-6
    assert render.culled == expected.culled == 0
    assert render.visible >= expected.visible
    blocks = -(-camera.width // 8) * -(-camera.height // 8)
    assert 64 * expected.visible <= render.pairs <= 64 * blocks * render.visible


def same_gradient(ours: torch.Tensor | None, theirs: torch.Tensor | None, what: str) -> None:
    assert ours is not None, what
    assert torch.isfinite(ours).all(), what
    if theirs is None or not theirs.any():
        assert not ours.any(), what
        return
    error = (ours.double() - theirs).abs()
    assert error.norm() < 1e-4 * theirs.norm(), what
    assert error.median() < 1e-5 * theirs.abs().mean(), what


def test_equals_cpu_kernels(scene_of: Any, device: str) -> None:
    """Also where many lists are longer than a chunk, and where the last chunks are never walked."""
    scene = smaller(scene_of("opaque"), 30)
    scene.camera = replace(scene.camera, width=20, height=8)
    first, second = scene.tensors(torch.float32), scene.tensors(torch.float32)
    ours, theirs = render_on(device, scene, first), scene.render(second)
    assert (ours.culled, ours.visible) == (theirs.culled, theirs.visible)
    assert ours.pairs < 64 * 3 * ours.visible
    torch.testing.assert_close(ours.image.cpu(), theirs.image, rtol=1e-5, atol=1e-6)
    loss(ours).backward()
    loss(theirs).backward()
    for a, b in zip(first, second, strict=True):
        assert (a.grad - b.grad).norm() < 1e-5 * b.grad.norm()


def test_gradient_of_each_gaussian_in_a_bright_scene(scene_of: Any, device: str) -> None:
    """Twelve decades of radiance: each Gaussian's own gradient is right, not only their sum."""
    scene = smaller(scene_of("bright"), 24)
    grads = []
    for dtype in (torch.float32, torch.float64):
        tensors = scene.tensors(dtype)
        render = scene.render(tensors) if dtype == torch.float64 else render_on(device, scene, tensors)
        torch.log(render.image + 1e-6).sum().backward()
        grads.append([t.grad.double() for t in tensors])
    for name, ours, theirs in zip(NAMES, *grads, strict=True):
        a, b = ours.reshape(len(ours), -1), theirs.reshape(len(theirs), -1)
        norm = b.norm(dim=1)
        error = ((a - b).norm(dim=1)[norm > 0] / norm[norm > 0]).numpy()
        assert np.median(error) < 1e-5, name
        assert np.quantile(error, 0.95) < 1e-3, name


@pytest.mark.parametrize("part", ["image", "alpha"])
def test_gradient_of_the_image_alone_and_of_alpha_alone(scene_of: Any, device: str, part: str) -> None:
    scene = smaller(scene_of("lens"), 8)
    fast, truth = scene.tensors(torch.float32), scene.tensors(torch.float64)
    (getattr(render_on(device, scene, fast), part) ** 2).sum().backward()
    (getattr(scene.render(truth), part) ** 2).sum().backward()
    for a, b, what in zip(fast, truth, NAMES[:4], strict=False):
        same_gradient(a.grad, b.grad, what)


def sheets(
    device: str, depths: list[float], opacities: list[float], light: list[float], limits: Limits
) -> Render:
    """Gaussians so wide that the image sees them as planes of one opacity."""
    n = len(depths)
    means = torch.tensor([[0.0, 0.0, z] for z in depths], device=device)
    quats = torch.tensor([[1.0, 0, 0, 0]] * n, device=device)
    scales = torch.tensor([[1e6, 1e6, 1e-3]] * n, device=device)
    colours = torch.tensor([[x] * 3 for x in light], device=device)
    return rasterize_gpu(
        means, quats, scales, torch.tensor(opacities, device=device), colours, CAMERA, None, limits, None
    )


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
    scene = smaller(scene_of("bright"), 12)
    scene.background = torch.tensor([0.25, 3.0, 1e-3]).double()
    render = render_on(device, scene, scene.tensors(torch.float32, grad=False))
    factor = 2.0**power
    scene.colours, scene.background = scene.colours * factor, scene.background * factor
    scene.limits = replace(scene.limits, luminance_reference=1e-6 * factor)
    scaled = render_on(device, scene, scene.tensors(torch.float32, grad=False))
    assert render.image.any()
    assert torch.equal(scaled.alpha, render.alpha)
    assert torch.equal(scaled.image, render.image * factor)


BAD = [math.nan, math.inf, -math.inf]
POISON = {
    "means": ([], [3e38, -3e38, 1e-45]),
    "quats": ([1e-45, 1e-30, 0.0], [3e38, 1e-18]),
    "scales": ([0.0, -1.0, 1e19, 3e38], [1e-45, 1e-30]),
    "opacities": ([-0.5], [0.0, 1e-45, 1.0, 1.5, 3e38, 1.0 / 255.0]),
    "colours": ([], [3e30, -1.0, 1e-45]),
}
"""Values that are culled besides those that are not finite, and values that are not."""


@pytest.mark.parametrize("field", list(POISON))
def test_poison_is_culled_and_counted(scene_of: Any, device: str, field: str) -> None:
    culled, drawn = POISON[field]
    values = [*BAD, *culled, *drawn]
    scene = smaller(scene_of("plain"), len(values) + 4)
    scene.camera = replace(scene.camera, width=12, height=10, cx=6.0, cy=5.0)
    scene.means[: len(values)] = torch.tensor([0.1, 0.05, 0.0]).double()  # in the middle of the image
    getattr(scene, field)[: len(values)] = (
        torch.tensor(values).float().double().reshape(-1, *[1] * (getattr(scene, field).dim() - 1))
    )
    tensors = scene.tensors(torch.float32)
    render = render_on(device, scene, tensors)
    bad = len(BAD) + len(culled)
    assert render.culled == bad
    assert torch.isfinite(render.image).all()
    render.image.clamp(max=1e6).sum().backward()
    assert all(torch.isfinite(t.grad).all() for t in tensors)
    assert not any(t.grad[:bad].any() for t in tensors)
    without = render_on(device, scene, [t.detach()[bad:] for t in tensors])
    assert without.culled == 0
    assert torch.equal(without.image, render.image)


def test_one_bad_number_is_enough(scene_of: Any, device: str) -> None:
    scene = smaller(scene_of("plain"), 14)
    tensors = scene.tensors(torch.float32, grad=False)
    row = 0
    for tensor in tensors:
        for column in range(tensor[0].numel()):
            tensor[row].view(-1)[column] = math.nan
            row += 1
    assert row == 14
    render = render_on(device, scene, tensors)
    assert (render.culled, render.visible, render.pairs) == (14, 0, 0)
    assert not render.image.any()


@pytest.mark.filterwarnings("ignore:.*encountered in:RuntimeWarning")  # NumPy's, in the interpreter
def test_an_overflow_stays_in_its_tile(device: str) -> None:
    """Lists lie one behind the other, and a list's last chunk reaches into the next."""
    means = torch.tensor([[-0.7, -0.5, 2.0], [0.8, -0.5, 2.0]])
    quats, scales = torch.tensor([[1.0, 0, 0, 0]]).repeat(2, 1), torch.full((2, 3), 0.05)
    opacities, colours = torch.full((2,), 0.5), torch.tensor([[1.0] * 3, [3e38] * 3])
    found = []
    for count in (1, 2):
        tensors = [t[:count].to(device).requires_grad_() for t in (means, quats, scales, opacities, colours)]
        render = rasterize_gpu(*tensors, CAMERA, None, Limits(), None)
        assert render.visible == count
        (render.image * 10).sum().backward()
        found.append([t.grad[0] for t in tensors])
    assert all(torch.equal(*pair) for pair in zip(*found, strict=True))
    assert all(torch.isfinite(gradient).all() for gradient in found[1])


def test_degenerate_needles(scene_of: Any, device: str) -> None:
    scene = smaller(scene_of("needles"), 6)
    scene.scales[:, 0] = torch.tensor([1e3, 1e4, 1e5, 1e6, 1e7, 1e10])
    scene.scales[:, 1] = scene.scales[:, 0] * 1e-9
    tensors = scene.tensors(torch.float32)
    render, truth = render_on(device, scene, tensors), scene.render(scene.tensors(torch.float64))
    assert render.culled == truth.culled > 0
    assert (render.image.cpu().double() - truth.image).abs().median() < 1e-4
    render.image.sum().backward()
    assert all(torch.isfinite(t.grad).all() for t in tensors)


def test_nothing_is_folded_back_into_the_image(device: str) -> None:
    """Beyond the radius where distortion stops growing, the polynomial would put Gaussians in the image."""
    camera = replace(CAMERA, k1=-0.5)
    for tangent, seen in ((1.2, 0), (0.3, 1)):
        tensors = [
            torch.tensor([[2 * tangent, 0.0, 2.0]], device=device),
            torch.tensor([[1.0, 0.0, 0.0, 0.0]], device=device),
            torch.full((1, 3), 0.05, device=device),
            torch.full((1,), 0.9, device=device),
            torch.ones(1, 3, device=device),
        ]
        render = rasterize_gpu(*tensors, camera, None, Limits(), None)
        assert (render.visible, render.culled) == (seen, 0)
        assert bool(render.image.any()) == bool(seen)


def test_opacity_above_the_largest_alpha_keeps_its_gradient(scene_of: Any, device: str) -> None:
    scene = smaller(scene_of("plain"), 8)
    scene.limits = replace(scene.limits, alpha_max=0.75)
    scene.opacities[3:6] = torch.tensor([0.75, 0.9, 1.5])
    found = []
    for opacities in (scene.opacities, scene.opacities.clamp(max=0.75)):
        scene.opacities = opacities
        tensors = scene.tensors(torch.float32)
        render = render_on(device, scene, tensors)
        render.image.sum().backward()
        found.append((render.image.detach(), tensors[3].grad))
    assert torch.equal(found[0][0], found[1][0])
    assert torch.equal(found[0][1], found[1][1])
    assert found[0][1][3:6].any()


def test_neither_order_nor_repetition_changes_a_bit(scene_of: Any, device: str) -> None:
    scene = smaller(scene_of("lens"))
    order = torch.tensor(np.random.default_rng(0).permutation(len(scene.means)))
    results = []
    for shuffled in (False, False, True):
        tensors, stats = scene.tensors(torch.float32, grad=False), SplatStats(len(order))
        if shuffled:
            tensors[:5] = [t[order] for t in tensors[:5]]
        tensors = [t.requires_grad_() for t in tensors]
        render = render_on(device, scene, tensors, stats)
        loss(render).backward()
        back = torch.argsort(order) if shuffled else torch.arange(len(order))
        grads = [*(t.grad[back] for t in tensors[:5]), tensors[5].grad, render.image.detach().cpu()]
        arrays = [*(t.numpy() for t in grads), stats.gradient[back], stats.weight[back]]
        results.append([array.tobytes() for array in arrays])
    assert results[0] == results[1] == results[2]


def test_several_renders_alive_and_backward_twice(scene_of: Any, device: str) -> None:
    scenes = [smaller(scene_of("lens"), 6), smaller(scene_of("background"), 6)]
    alone = []
    for scene in scenes:
        tensors = scene.tensors(torch.float32)
        loss(render_on(device, scene, tensors)).backward()
        alone.append([t.grad for t in tensors])
    together = [scene.tensors(torch.float32) for scene in scenes]
    value = sum(loss(render_on(device, *pair)) for pair in zip(scenes, together, strict=True))
    value.backward(retain_graph=True)
    value.backward()
    for expected, tensors in zip(alone, together, strict=True):
        assert all(torch.equal(2 * x, t.grad) for x, t in zip(expected, tensors, strict=True))


def test_statistics_add_up_over_renders(scene_of: Any, device: str) -> None:
    scene = smaller(scene_of("lens"), 6)
    found = []
    for seeds in ((0,), (1,), (0, 1)):
        stats = SplatStats(len(scene.means))
        for seed in seeds:
            loss(render_on(device, scene, scene.tensors(torch.float32), stats), seed).backward()
        found.append(stats)
    first, second, both = found
    assert both.seen.max() == 2
    assert np.array_equal(first.seen + second.seen, both.seen)
    np.testing.assert_allclose(first.gradient + second.gradient, both.gradient, rtol=1e-6)
    np.testing.assert_array_equal(np.maximum(first.weight, second.weight), both.weight)


def test_strided_and_partly_constant_inputs(scene_of: Any, device: str) -> None:
    scene = smaller(scene_of("plain"), 6)
    plain = scene.tensors(torch.float32)
    loss(render_on(device, scene, plain)).backward()
    tensors = scene.tensors(torch.float32, grad=False)
    wide = torch.zeros(len(tensors[0]), 6)
    wide[:, ::2] = tensors[0]
    wide.requires_grad_()
    loss(render_on(device, scene, [wide[:, ::2], *tensors[1:]])).backward()
    assert torch.equal(wide.grad[:, ::2], plain[0].grad)
    with torch.no_grad():
        assert not render_on(device, scene, plain).image.requires_grad


def test_gradient_of_the_camera(scene_of: Any, device: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Against the oracle, through the same entry."""
    scene = smaller(scene_of("lens"), 10)
    found = []
    for dtype, place in ((torch.float64, "cpu"), (torch.float32, device)):
        tensors = [t.to(place) for t in scene.tensors(dtype, grad=False)]
        delta = torch.full((14,), 1e-3, dtype=torch.float64, requires_grad=True)
        render = rasterize(*tensors[:5], scene.camera, tensors[5], scene.limits, camera_delta=delta)
        loss(render).backward()
        found.insert(0, delta.grad)
        monkeypatch.setattr(splat, "_rasterizer", lambda *_: rasterize_gpu)
    assert (found[0] - found[1]).abs().max() < 1e-5 * found[1].abs().max()
    torch.testing.assert_close(found[0], found[1], rtol=1e-3, atol=1e-6 * float(found[1].abs().max()))


def test_constants_are_those_of_the_cpu_kernels() -> None:
    from recon.splat import composite as numba
    from recon.splat import cpu
    from recon.splat.gpu import composite, rasterizer, tiles
    from recon.splat.tiles import _SLACK

    for name in ("P0", "P1", "P2", "P3", "P4"):
        assert np.float32(getattr(composite, name).value) == getattr(numba, f"_{name}")
    assert rasterizer._T_LEAST == cpu._T_LEAST
    assert tiles._SLACK.value == _SLACK


def test_tensors_are_told_where_to_go(scene_of: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    tensors = scene_of("plain").tensors(torch.float32, grad=False)
    assert splat._rasterizer("cuda", torch.float32) is rasterize_gpu
    with pytest.raises(ValueError, match="opacities is on meta and means on cpu: move them to one device"):
        rasterize(*tensors[:3], tensors[3].to("meta"), tensors[4], CAMERA)
    with pytest.raises(ValueError, match="the tensors are on meta"):
        rasterize(*(t.to("meta") for t in tensors), CAMERA)
    for name in [name for name in sys.modules if name.startswith("recon.splat.gpu")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "triton", None)
    with pytest.raises(ReconstructionError, match=r"needs Triton 3\.4 or newer: install torch"):
        splat._rasterizer("cuda", torch.float32)

"""The Triton rasteriser against the dense float64 oracle with the same cut-offs, and against the CPU kernels.

On a CUDA GPU where there is one, else through Triton's interpreter: slow, hence the smaller scenes.
"""

import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

import recon.splat as splat
from imaging.errors import InputError, ReconstructionError
from recon.splat import Render, SplatCamera, SplatStats, rasterize
from tests.recon.splat.oracle import same_gradient, same_image, same_statistics

pytest.importorskip("triton", reason="Triton is for Linux")

from recon.splat.gpu import rasterize_gpu

NAMES = ("means", "quats", "scales", "opacities", "colours")
CAMERA = SplatCamera(np.eye(4), fx=20, fy=20, cx=12, cy=9, width=24, height=18)
SCENES = [
    "plain", "background", "lens", "strong lens", "bright", "big", "needles", "near lens", "opaque",
    "fisheye", "near fisheye", "same place", "3dgs", "1x1", "17x3", "none", "one", "behind", "inside",
]  # fmt: skip


def loss(render: Render, seed: int = 0) -> torch.Tensor:
    """A smooth function of image and alpha, with another gradient at every pixel."""
    rng = np.random.default_rng(seed)
    a, b = (torch.tensor(rng.normal(size=tuple(x.shape))) for x in (render.image, render.alpha))
    return (a * torch.log1p(render.image.cpu().double())).sum() + (b * render.alpha.cpu().double()).sum()


def agrees(scene: Any, device: str) -> tuple[SplatStats, SplatStats]:
    """Compare image, alpha, gradients and statistics with those of the float64 oracle."""
    fast, truth = scene.tensors(torch.float32), scene.tensors(torch.float64)
    ours, theirs = SplatStats(len(fast[0]), torch.device(device)), SplatStats(len(fast[0]))
    render, expected = scene.render_on(device, fast, ours), scene.render(truth, theirs)
    assert (render.image.device.type, render.image.dtype) == (device, torch.float32)
    same_image(render, expected, scene.camera)
    loss(render).backward()
    loss(expected).backward()
    for a, b, what in zip(fast, truth, (*NAMES, "background"), strict=False):
        same_gradient(a.grad, b.grad, what, 1e-4)
    same_statistics(ours, theirs, 1e-4)
    return ours, theirs


@pytest.mark.parametrize("name", SCENES)
def test_equals_oracle(scene_of: Any, device: str, name: str) -> None:
    """Image, alpha, counts, gradients and statistics."""
    ours, theirs = agrees(scene_of(name).smaller(), device)
    assert torch.equal(ours.weight.cpu() > 0, theirs.weight > 0)


def test_equals_cpu_kernels(scene_of: Any, device: str) -> None:
    """Also where many lists are longer than a chunk, and where the last chunks are never walked."""
    scene = scene_of("opaque").smaller(30)
    scene.camera = replace(scene.camera, width=20, height=8)
    first, second = scene.tensors(torch.float32), scene.tensors(torch.float32)
    ours, theirs = scene.render_on(device, first), scene.render(second)
    assert (ours.culled, ours.visible) == (theirs.culled, theirs.visible)
    assert ours.pairs < 64 * 3 * ours.visible
    torch.testing.assert_close(ours.image.cpu(), theirs.image, rtol=1e-5, atol=1e-6)
    loss(ours).backward()
    loss(theirs).backward()
    for a, b in zip(first, second, strict=True):
        assert (a.grad - b.grad).norm() < 1e-5 * b.grad.norm()


def test_gradient_of_each_gaussian_in_a_bright_scene(scene_of: Any, device: str) -> None:
    """Twelve decades of radiance: each Gaussian's own gradient is right, not only their sum."""
    scene = scene_of("bright").smaller(24)
    grads = []
    for dtype in (torch.float32, torch.float64):
        tensors = scene.tensors(dtype)
        render = scene.render(tensors) if dtype == torch.float64 else scene.render_on(device, tensors)
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
    scene = scene_of("lens").smaller(8)
    fast, truth = scene.tensors(torch.float32), scene.tensors(torch.float64)
    (getattr(scene.render_on(device, fast), part) ** 2).sum().backward()
    (getattr(scene.render(truth), part) ** 2).sum().backward()
    for a, b, what in zip(fast, truth, NAMES[:4], strict=False):
        same_gradient(a.grad, b.grad, what, 1e-4)


def test_neither_order_nor_repetition_changes_a_bit(scene_of: Any, device: str) -> None:
    scene = scene_of("lens").smaller()
    order = torch.tensor(np.random.default_rng(0).permutation(len(scene.means)))
    results = []
    for shuffled in (False, False, True):
        tensors = scene.tensors(torch.float32, grad=False)
        stats = SplatStats(len(order), torch.device(device))
        if shuffled:
            tensors[:5] = [t[order] for t in tensors[:5]]
        tensors = [t.requires_grad_() for t in tensors]
        render = scene.render_on(device, tensors, stats)
        loss(render).backward()
        back = torch.argsort(order) if shuffled else torch.arange(len(order))
        grads = [*(t.grad[back] for t in tensors[:5]), tensors[5].grad, render.image.detach().cpu()]
        arrays = [*grads, stats.tension.cpu()[back], stats.weight.cpu()[back]]
        results.append([array.numpy().tobytes() for array in arrays])
    assert results[0] == results[1] == results[2]


def test_several_renders_alive_and_backward_twice(scene_of: Any, device: str) -> None:
    scenes = [scene_of("lens").smaller(6), scene_of("background").smaller(6)]
    alone = []
    for scene in scenes:
        tensors = scene.tensors(torch.float32)
        loss(scene.render_on(device, tensors)).backward()
        alone.append([t.grad for t in tensors])
    together = [scene.tensors(torch.float32) for scene in scenes]
    value = sum(
        loss(scene.render_on(device, tensors)) for scene, tensors in zip(scenes, together, strict=True)
    )
    value.backward(retain_graph=True)
    value.backward()
    for expected, tensors in zip(alone, together, strict=True):
        assert all(torch.equal(2 * x, t.grad) for x, t in zip(expected, tensors, strict=True))


def test_statistics_add_up_over_renders(scene_of: Any, device: str) -> None:
    scene = scene_of("lens").smaller(6)
    statistics = []
    for seeds in ((0,), (1,), (0, 1)):
        stats = SplatStats(len(scene.means), torch.device(device))
        for seed in seeds:
            loss(scene.render_on(device, scene.tensors(torch.float32), stats), seed).backward()
        statistics.append(stats)
    first, second, both = statistics
    assert both.tension.max() > first.tension.max()
    torch.testing.assert_close(first.tension + second.tension, both.tension, rtol=1e-6, atol=0)
    assert torch.equal(torch.maximum(first.weight, second.weight), both.weight)


def test_strided_and_partly_constant_inputs(scene_of: Any, device: str) -> None:
    scene = scene_of("plain").smaller(6)
    plain = scene.tensors(torch.float32)
    loss(scene.render_on(device, plain)).backward()
    tensors = scene.tensors(torch.float32, grad=False)
    wide = torch.zeros(len(tensors[0]), 6)
    wide[:, ::2] = tensors[0]
    wide.requires_grad_()
    loss(scene.render_on(device, [wide[:, ::2], *tensors[1:]])).backward()
    assert torch.equal(wide.grad[:, ::2], plain[0].grad)
    with torch.no_grad():
        assert not scene.render_on(device, plain).image.requires_grad


@pytest.mark.parametrize("name", ["lens", "fisheye"])
def test_gradient_of_the_camera(
    scene_of: Any, device: str, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Against the oracle, through the same entry."""
    scene = scene_of(name).smaller(10)
    gradients = []
    for dtype, place in ((torch.float64, "cpu"), (torch.float32, device)):
        tensors = [t.to(place) for t in scene.tensors(dtype, grad=False)]
        delta = torch.full((14,), 1e-3, dtype=torch.float64, requires_grad=True)
        render = rasterize(*tensors[:5], scene.camera, tensors[5], scene.limits, camera_delta=delta)
        loss(render).backward()
        gradients.insert(0, delta.grad)
        monkeypatch.setattr(splat, "_rasterizer", lambda *_: rasterize_gpu)
    assert (gradients[0] - gradients[1]).abs().max() < 1e-5 * gradients[1].abs().max()
    torch.testing.assert_close(
        gradients[0], gradients[1], rtol=1e-3, atol=1e-6 * float(gradients[1].abs().max())
    )


def test_constants_are_those_of_the_cpu_kernels() -> None:
    from recon.splat.cpu import composite as numba
    from recon.splat.gpu import composite

    for name in ("P0", "P1", "P2", "P3", "P4"):
        assert np.float32(getattr(composite, name).value) == getattr(numba, f"_{name}")


def test_tensors_are_told_where_to_go(scene_of: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    tensors = scene_of("plain").tensors(torch.float32, grad=False)
    assert splat._rasterizer("cuda", torch.float32) is rasterize_gpu
    with pytest.raises(InputError, match="opacities is on meta and means on cpu: move them to one device"):
        rasterize(*tensors[:3], tensors[3].to("meta"), tensors[4], CAMERA)
    with pytest.raises(InputError, match="the tensors are on meta"):
        rasterize(*(t.to("meta") for t in tensors), CAMERA)
    for name in [name for name in sys.modules if name.startswith("recon.splat.gpu")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "triton", None)
    with pytest.raises(ReconstructionError, match=r"needs Triton 3\.4 or newer: install torch"):
        splat._rasterizer("cuda", torch.float32)

"""Float32 where the GPU's kernels use it: digits that are left at the extremes, beside the float64 oracle."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch

from recon.splat import Limits
from tests.recon.splat.conftest import BACK, Scene, camera, cloud, pose
from tests.recon.splat.test_gpu import NAMES

pytest.importorskip("triton", reason="Triton is for Linux")

from recon.splat.gpu import slots


def _bright() -> Scene:
    """2^20 between the darkest and the brightest."""
    scene = Scene(**cloud(14, 7, size=0.15), camera=camera(20, 15), limits=Limits.for_scene(1.0, 2.0**20))
    exponents = torch.linspace(0, 20, 14)[torch.randperm(14, generator=torch.Generator().manual_seed(0))]
    scene.colours = torch.exp2(exponents).double()[:, None].repeat(1, 3)
    return scene


def _sized(size: float) -> Scene:
    return Scene(**cloud(10, 21, size=size, spread=0.4), camera=camera(20, 15), background=BACK)


def _discs_on_edge() -> Scene:
    """Discs a hundred pictures wide, seen from the side."""
    scene = _sized(1.0)
    scene.scales[:] = torch.tensor([100.0, 100.0, 1e-3]).float().double()
    return scene


def _far_from_the_origin() -> Scene:
    """The scene and the camera are moved by 2^12, where float32 has steps of 2^-11."""
    scene = Scene(**cloud(14, 22), camera=camera(20, 15), background=BACK)
    scene.means = (scene.means * 2**11).round() / 2**11 + 2.0**12
    motion = pose(turn=0.3)
    motion[:3, 3] -= motion[:3, :3] @ np.full(3, 2.0**12)
    scene.camera = replace(scene.camera, cam_from_world=motion)
    return scene


def _off_the_picture() -> Scene:
    """A strip cut out of a picture 16,000 px wide, whose principal point is far outside it; long needles."""
    scene = Scene(**cloud(14, 23), camera=camera(20, 15), background=BACK)
    shift = 16000.0
    scene.camera = replace(scene.camera, fx=shift, fy=shift, cx=10 - 0.5 * shift, cy=7 - 0.5 * shift)
    scene.camera = replace(scene.camera, cam_from_world=np.eye(4))
    depth = torch.linspace(2, 4, 14).double()
    beside = torch.tensor(np.random.default_rng(1).normal(0, 3e-4, (14, 2)))
    scene.means = torch.cat([(0.5 + beside) * depth[:, None], depth[:, None]], 1).float().double()
    scene.scales = torch.tensor([0.1, 2e-4, 2e-4]).repeat(14, 1).float().double()
    return scene


SCENES: dict[str, Callable[[], Scene]] = {
    "2^20 of light": _bright,
    "tiny": lambda: _sized(1e-4),
    "huge": lambda: _sized(1e4),
    "discs on edge": _discs_on_edge,
    "far from the origin": _far_from_the_origin,
    "off the picture": _off_the_picture,
}


@pytest.mark.parametrize("name", list(SCENES))
def test_each_gaussian_is_right(device: str, name: str) -> None:
    """The image, and the gradient of each Gaussian by itself."""
    scene = SCENES[name]()
    scene.limits = replace(scene.limits, luminance_reference=scene.limits.luminance_reference or 1e-6)
    images, grads = [], []
    for dtype in (torch.float32, torch.float64):
        tensors = scene.tensors(dtype)
        render = scene.render(tensors) if dtype == torch.float64 else scene.render_on(device, tensors)
        rng = np.random.default_rng(3)
        pull = torch.tensor(rng.normal(size=tuple(render.image.shape)))
        (pull * torch.log(render.image.cpu().double() + 1e-3)).sum().backward()
        images.append(render.image.detach().cpu().double())
        grads.append([t.grad.double() for t in tensors[:5]])
    assert images[1].max() > 0.01
    error = (images[0] - images[1]).abs() / (images[1].abs() + 1e-3)
    assert error.mean() < 1e-5
    assert error.max() < 1e-3
    for what, ours, theirs in zip(NAMES, *grads, strict=True):
        a, b = ours.reshape(len(ours), -1), theirs.reshape(len(theirs), -1)
        norm = b.norm(dim=1)
        there = norm > 1e-9 * norm.max()
        # Of one whose pixels cancel, what is left says nothing of its digits.
        size = norm[there].clamp(min=0.02 * float(norm[there].median()))
        wrong = ((a - b).norm(dim=1)[there] / size).numpy()
        assert np.median(wrong) < 4e-6, what
        assert wrong.max() < 1e-4, what


def test_slots_of_a_gaussian_that_covers_a_picture(device: str) -> None:
    """20,000 slots, the tiles of 1,600x1,600 px, beside one; sums of float64 are the truth."""
    rng = np.random.default_rng(4)
    values = rng.normal(0.1, 1.0, (20001, slots.SLOT.value)).astype(np.float32)
    values[:, 9:] = np.abs(values[:, 9:]) + 1
    start, number = torch.tensor([0, 20000]).to(device), torch.tensor([20000, 1]).to(device)
    moments, colours = torch.empty(2, 6, device=device), torch.empty(2, 3, device=device)
    pull, weight = torch.empty(2, 2, device=device)
    slots.add_slots[(1,)](
        torch.from_numpy(values).to(device), start, number, 2, moments, colours, pull, weight,
        BLOCK=slots.BLOCK, num_warps=slots.WARPS,
    )  # fmt: skip
    sums = np.stack([values[:20000].sum(axis=0, dtype=np.float64), values[20000]])
    sizes = np.stack([np.abs(values[:20000]).sum(axis=0, dtype=np.float64), np.abs(values[20000])])
    ours = torch.cat([moments, colours], 1).cpu().numpy()
    assert (np.abs(ours - sums[:, :9]) < 2e-6 * sizes[:, :9]).all()
    np.testing.assert_allclose(
        pull.cpu(), np.sqrt(np.maximum(sums[:, 9] ** 2 - sums[:, 0] ** 2, 0)), rtol=1e-5
    )
    assert weight.tolist() == [values[:20000, 10].max(), values[20000, 10]]

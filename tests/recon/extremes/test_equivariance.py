"""Invariances of the picture: the unit of light, a motion of the world, order, threads."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

import imaging.compute.threads as threads
from recon.splat import SplatStats


@pytest.mark.parametrize("power", range(-20, 21))
def test_radiance_scales_exactly(scene_of: Any, dtype: torch.dtype, power: int) -> None:
    """Light times 2^k: alpha, visibility and work are the same, the image and its gradients are times 2^k."""
    scene = scene_of("bright")
    keep = slice(0, 80 if dtype == torch.float32 else 20)
    for name in ("means", "quats", "scales", "opacities", "colours"):
        setattr(scene, name, getattr(scene, name)[keep])
    scene.background = torch.tensor([0.25, 3.0, 1e-3]).float().double()
    colours, background, results = scene.colours, scene.background, []
    for factor in (1.0, 2.0**power):
        scene.colours, scene.background = colours * factor, background * factor
        scene.limits = replace(scene.limits, luminance_reference=1e-6 * factor)
        tensors = scene.tensors(dtype)
        render = scene.render(tensors)
        pull = torch.randn(render.image.shape, generator=torch.Generator().manual_seed(3)).to(dtype)
        render.image.backward(pull)
        results.append((render, [tensor.grad for tensor in tensors]))
    (plain, grads), (scaled, scaled_grads) = results
    factor = 2.0**power
    assert torch.equal(scaled.alpha, plain.alpha)
    assert torch.equal(scaled.image, plain.image * factor)
    assert (scaled.visible, scaled.pairs) == (plain.visible, plain.pairs)
    for number, (a, b) in enumerate(zip(grads, scaled_grads, strict=True)):
        # d image / d colour does not know how bright it is; every other slope is in units of light.
        assert torch.equal(b, a if number >= 4 else a * factor), number


def test_rigid_motion_of_the_world_changes_nothing(scene_of: Any, dtype: torch.dtype) -> None:
    """About any axis; the gradient of the means turns with them."""
    scene = scene_of("lens")
    tensors = scene.tensors(dtype)
    render = scene.render(tensors)
    render.image.square().sum().backward()
    for vector in ((0.0, 0.0, 0.7), (1.1, -0.4, 0.2), (0.0, math.pi, 0.0)):
        axis = np.array(vector)
        angle = float(np.linalg.norm(axis))
        c, (x, y, z) = math.cos(angle / 2), math.sin(angle / 2) * axis / angle
        spin = _matrix(c, x, y, z)
        motion = np.eye(4)
        motion[:3, :3], motion[:3, 3] = spin, (3.0, -2.0, 1.0)
        turned = replace(scene, quats=_product((c, x, y, z), scene.quats))
        turned.means = scene.means @ torch.tensor(spin.T) + torch.tensor(motion[:3, 3])
        pose = scene.camera.cam_from_world @ np.linalg.inv(motion)
        turned.camera = replace(scene.camera, cam_from_world=pose)
        others = turned.tensors(dtype)
        moved = turned.render(others)
        moved.image.square().sum().backward()
        error = (moved.image - render.image).abs().detach()
        exact = dtype == torch.float64  # float32 means in the new place are rounded
        assert error.mean() < (1e-12 if exact else 1e-5)
        assert error.median() < (1e-12 if exact else 1e-5)
        back = others[0].grad.double() @ torch.tensor(spin)
        assert (back - tensors[0].grad).norm() < (1e-9 if exact else 1e-3) * tensors[0].grad.norm()


def _matrix(w: float, x: float, y: float, z: float) -> np.ndarray:
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def _product(turn: tuple[float, float, float, float], quats: torch.Tensor) -> torch.Tensor:
    """The quaternions wxyz of `quats` [N, 4], turned."""
    a, b, c, d = turn
    w, x, y, z = quats.unbind(1)
    return torch.stack(
        [
            a * w - b * x - c * y - d * z,
            a * x + b * w + c * z - d * y,
            a * y - b * z + c * w + d * x,
            a * z + b * y - c * x + d * w,
        ],
        dim=1,
    )


def test_length_and_sign_of_quaternions_change_nothing(scene_of: Any, dtype: torch.dtype) -> None:
    scene = scene_of("lens")
    render = scene.render(scene.tensors(dtype, grad=False))
    for factor in (-1.0, 2.0**40, 2.0**-40):
        other = replace(scene, quats=scene.quats * factor)
        image = other.render(other.tensors(dtype, grad=False)).image
        torch.testing.assert_close(image, render.image, rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("name", ["many", "bright", "opaque"])
def test_order_of_gaussians_changes_nothing(scene_of: Any, name: str) -> None:
    scene = scene_of(name)
    order = torch.tensor(np.random.default_rng(0).permutation(len(scene.means)))
    first = scene.tensors(torch.float32)
    second = [tensor.detach() for tensor in first]
    second = [(t[order] if len(t) == len(order) else t).requires_grad_() for t in second]
    a, b = scene.render(first), scene.render(second)
    assert torch.equal(a.image, b.image)
    torch.log1p(a.image).sum().backward()
    torch.log1p(b.image).sum().backward()
    assert all(torch.equal(x.grad[order], y.grad) for x, y in zip(first[:5], second[:5], strict=True))


def test_thread_count_changes_no_bit(decades: Any) -> None:
    """Over twelve decades, where a sum in another order would show at once."""
    before, results = threads.thread_count(), []
    # More Gaussians than one thread takes at a time.
    for name in ("means", "quats", "scales", "opacities", "colours"):
        values = getattr(decades, name)
        setattr(decades, name, values.repeat(6, *[1] * (values.ndim - 1)))
    try:
        for count in (1, 2, 3, 7):
            threads.set_threads(count)
            stats = SplatStats(len(decades.means))
            tensors = decades.tensors(torch.float32)
            render = decades.render(tensors, stats)
            torch.log(render.image + 1e-6).sum().backward()
            arrays = [render.image.detach(), render.alpha.detach(), *(t.grad for t in tensors)]
            arrays += [stats.tension, stats.weight]
            results.append([array.numpy().tobytes() for array in arrays])
    finally:
        threads.set_threads(before)
    assert all(result == results[0] for result in results)

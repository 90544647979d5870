"""Gradients by the pose and the lens: Numba against the oracle, and the oracle against differences."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

import imaging.compute.threads as threads
from imaging.errors import InputError
from recon.splat import Limits, Render, rasterize
from recon.splat.corrected_camera import DELTA, moved

SMOOTH = Limits(alpha_min=1e-18, t_min=0.0, near=1e-3, tangent_margin=1e3)
"""Nothing is cut off and no Jacobian is clamped, so the render is a smooth function of the camera."""
STEPS = torch.tensor([1e-3] * 3 + [1e-3] * 3 + [0.1] * 4 + [1e-3] * 4).double()
"""About a twentieth of a pixel each."""
SCENES = [
    "background",
    "lens",
    "strong lens",
    "fisheye",
    "near fisheye",
    "big",
    "needles",
    "near lens",
    "many",
    "inside",
    "bright",
    "1x1",
]
DIFFERENTIABLE = [
    "background", "lens", "strong lens", "fisheye", "near fisheye", "big", "needles", "near lens", "1x1",
]  # fmt: skip


def drawn(scene: Any, tensors: list[torch.Tensor], delta: torch.Tensor | None) -> Render:
    background = tensors[5] if len(tensors) > 5 else None
    return rasterize(*tensors[:5], scene.camera, background, scene.limits, None, delta)


def value(scene: Any, tensors: list[torch.Tensor], delta: torch.Tensor) -> torch.Tensor:
    """A smooth function of the image and alpha, with another gradient at every pixel."""
    render = drawn(scene, tensors, delta)
    rng = np.random.default_rng(3)
    a = torch.tensor(rng.normal(size=tuple(render.image.shape)), dtype=render.image.dtype)
    b = torch.tensor(rng.normal(size=tuple(render.alpha.shape)), dtype=render.image.dtype)
    return (a * torch.log1p(render.image)).sum() + (b * render.alpha).sum()


def start(zero: bool) -> torch.Tensor:
    """No motion, or some of every kind."""
    push = torch.tensor(np.random.default_rng(4).normal(size=DELTA)) * STEPS * 10
    return torch.zeros(DELTA).double() if zero else push


@pytest.mark.parametrize("zero", [True, False])
@pytest.mark.parametrize("name", SCENES)
def test_kernels_equal_the_oracle(scene_of: Any, name: str, zero: bool) -> None:
    """With the cut-offs of the scene: number by number, in units of a visible step."""
    scene, gradients = scene_of(name), []
    for dtype in (torch.float32, torch.float64):
        delta = start(zero).requires_grad_()
        tensors = scene.tensors(dtype)
        value(scene, tensors, delta).backward()
        gradients.append(delta.grad * STEPS)
        assert all(torch.isfinite(tensor.grad).all() for tensor in tensors)
    ours, truth = gradients
    assert truth.any()
    assert (ours - truth).norm() < 1e-3 * truth.norm(), name
    assert ((ours - truth).abs() < 1e-3 * truth.abs() + 1e-4 * truth.norm()).all(), name


@pytest.mark.parametrize("zero", [True, False])
@pytest.mark.parametrize("name", DIFFERENTIABLE)
def test_gradients_equal_finite_differences(scene_of: Any, name: str, zero: bool) -> None:
    """Each of the fourteen by itself."""
    scene = scene_of(name)
    scene.limits = SMOOTH
    for field in ("means", "quats", "scales", "opacities", "colours"):
        setattr(scene, field, getattr(scene, field)[:6])
    if name.startswith("near "):  # in front of the camera, so that no step crosses the near plane
        scene.means[:, 2] = scene.means[:, 2].abs() + 0.1
    delta = start(zero).requires_grad_()
    tensors = scene.tensors(torch.float64, grad=False)
    value(scene, tensors, delta).backward()
    fast = start(zero).requires_grad_()
    value(scene, scene.tensors(torch.float32), fast).backward()
    size = float((delta.grad * STEPS).norm())
    with torch.no_grad():
        for number in range(DELTA):
            # Richardson extrapolation of central differences: error of fourth order.
            slopes = []
            for part in (2e-2, 1e-2):
                step = torch.zeros(DELTA).double()
                step[number] = part * STEPS[number]
                ends = [value(scene, tensors, delta.detach() + sign * step) for sign in (1, -1)]
                slopes.append((ends[0] - ends[1]) / (2 * part))
            expected = float((4 * slopes[1] - slopes[0]) / 3)
            gradient, ours = (float(d.grad[number] * STEPS[number]) for d in (delta, fast))
            assert abs(gradient - expected) < 1e-6 * abs(expected) + 1e-7 * size, number
            assert abs(ours - expected) < 1e-3 * abs(expected) + 1e-4 * size, number


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_a_delta_is_the_camera_that_it_makes(scene_of: Any, dtype: torch.dtype) -> None:
    scene = scene_of("lens")
    tensors = scene.tensors(dtype, grad=False)
    plain = drawn(scene, tensors, None)
    same = drawn(scene, tensors, torch.zeros(DELTA, dtype=dtype))
    assert torch.equal(plain.image, same.image)
    assert torch.equal(plain.alpha, same.alpha)
    delta = start(False).to(dtype)
    there = drawn(scene, tensors, delta)
    scene.camera, _ = moved(scene.camera, delta)
    assert torch.equal(there.image, drawn(scene, tensors, None).image)
    assert not torch.equal(there.image, plain.image)


def test_conventions(scene_of: Any) -> None:
    """The motion acts in camera axes, after cam_from_world; the lens is added to."""
    camera = scene_of("lens").camera
    turned, _ = moved(camera, torch.tensor([0, 0, 0, 0.1, -0.2, 0.3] + [0.0] * 8, dtype=torch.float64))
    expected = np.eye(4)
    expected[:3, :3] = Rotation.from_rotvec([0.1, -0.2, 0.3]).as_matrix()
    np.testing.assert_allclose(turned.cam_from_world, expected @ camera.cam_from_world, atol=1e-14)
    steps = [4, 5, 6, 7, 0.1, 0.2, 0.3, 0.4]
    pushed, _ = moved(camera, torch.tensor([1.0, 2, 3, 0, 0, 0, *steps], dtype=torch.float64))
    expected = np.eye(4)
    expected[:3, 3] = 1, 2, 3
    np.testing.assert_allclose(pushed.cam_from_world, expected @ camera.cam_from_world, atol=1e-14)
    for name, step in zip(("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"), steps, strict=True):
        assert getattr(pushed, name) == pytest.approx(getattr(camera, name) + step, rel=1e-12)


def test_lens_of_the_delta_folds_nothing_back(scene_of: Any) -> None:
    """The last radius that is drawn is that of the moved lens, not of the lens before."""
    scene = scene_of("one")
    scene.camera = replace(scene.camera, cam_from_world=np.eye(4), cx=20.0)
    scene.means[0] = torch.tensor([2.4, 0.0, 2.0])
    delta = torch.zeros(DELTA).double()
    delta[10] = -0.5
    for dtype in (torch.float32, torch.float64):
        assert drawn(scene, scene.tensors(dtype, grad=False), delta).visible == 0


def test_thread_count_changes_no_bit(scene_of: Any) -> None:
    """With more Gaussians than a thread takes at a time; and the sum over all of them is the oracle's."""
    scene = scene_of("many")
    for name in ("means", "quats", "scales", "opacities", "colours"):
        setattr(scene, name, getattr(scene, name).repeat(4, *[1] * (getattr(scene, name).ndim - 1)))
    before, results = threads.thread_count(), []
    try:
        for count in (1, 2, 3):
            threads.set_threads(count)
            delta = start(False).requires_grad_()
            value(scene, scene.tensors(torch.float32), delta).backward()
            results.append(delta.grad.numpy().tobytes())
    finally:
        threads.set_threads(before)
    assert results[0] == results[1] == results[2]
    truth = start(False).requires_grad_()
    value(scene, scene.tensors(torch.float64), truth).backward()
    assert ((delta.grad - truth.grad) * STEPS).norm() < 1e-3 * (truth.grad * STEPS).norm()


def test_gaussians_do_not_notice(scene_of: Any) -> None:
    """Their gradients are the same bits with a delta and without; a constant delta gets none."""
    scene, grads = scene_of("many"), []
    for delta in (None, torch.zeros(DELTA), torch.zeros(DELTA, requires_grad=True)):
        tensors = scene.tensors(torch.float32)
        drawn(scene, tensors, delta).image.square().sum().backward()
        grads.append([tensor.grad for tensor in tensors])
        assert delta is None or (delta.grad is not None) == delta.requires_grad
    for other in grads[1:]:
        assert all(torch.equal(a, b) for a, b in zip(grads[0], other, strict=True))


def test_a_constant_scene_still_moves_the_camera(scene_of: Any) -> None:
    scene, grads = scene_of("lens"), []
    for grad in (True, False):
        delta = torch.zeros(DELTA, requires_grad=True)
        drawn(scene, scene.tensors(torch.float32, grad=grad), delta).image.sum().backward()
        grads.append(delta.grad)
    assert grads[0].any()
    assert torch.equal(*grads)


@pytest.mark.parametrize("name", ["none", "behind"])
def test_nothing_seen_gives_zeros(scene_of: Any, name: str) -> None:
    for dtype in (torch.float32, torch.float64):
        delta = torch.zeros(DELTA, requires_grad=True)
        scene = scene_of(name)
        drawn(scene, scene.tensors(dtype), delta).image.sum().backward()
        assert delta.grad is None or not delta.grad.any()


def test_wrong_deltas_are_named(scene_of: Any) -> None:
    scene = scene_of("plain")
    tensors = scene.tensors(torch.float32, grad=False)
    with pytest.raises(InputError, match="camera_delta has shape"):
        drawn(scene, tensors, torch.zeros(6))
    with pytest.raises(InputError, match="camera_delta is not finite"):
        drawn(scene, tensors, torch.full((DELTA,), float("nan")))


def test_a_displaced_camera_finds_back(scene_of: Any) -> None:
    """Use the gradient: pose and focal lengths from a picture, within a hundredth of the error."""
    scene = scene_of("many")
    scene.limits = Limits(alpha_min=1e-4)
    tensors = scene.tensors(torch.float32, grad=False)
    target = drawn(scene, tensors, None).image
    push = torch.tensor([0.02, -0.03, 0.02, 0.01, -0.02, 0.015, 0.3, -0.4] + [0.0] * 6).double()
    scene.camera, _ = moved(scene.camera, push)
    scaled = torch.zeros(8).double().requires_grad_()
    optimizer = torch.optim.LBFGS([scaled], max_iter=60, line_search_fn="strong_wolfe")

    def closure() -> torch.Tensor:
        optimizer.zero_grad()
        delta = torch.cat([scaled, torch.zeros(6).double()]) * STEPS
        error = 1e3 * (drawn(scene, tensors, delta).image - target).square().mean()
        error.backward()
        return error

    first = float(closure().detach())
    optimizer.step(closure)
    assert float(closure().detach()) < 1e-4 * first
    back, _ = moved(scene.camera, torch.cat([scaled.detach(), torch.zeros(6).double()]) * STEPS)
    original = scene_of("many").camera
    assert np.abs(back.cam_from_world - original.cam_from_world).max() < 3e-4
    assert abs(back.fx - original.fx) < 4e-3

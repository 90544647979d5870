"""The oracle against finite differences, on smooth variants of the cut-offs, and against made-up cases."""

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
import torch

from recon.splat import Limits, SplatCamera, rasterize
from recon.splat.reference import rotation_matrices

SMOOTH = Limits(alpha_min=1e-18, t_min=0.0, near=1e-3)
"""Nothing is cut off, so the render is a smooth function of every input."""


@pytest.mark.parametrize("name", ["background", "lens", "strong lens", "big", "needles", "near lens", "1x1"])
def test_gradients_equal_finite_differences(scene_of: Any, name: str) -> None:
    scene = scene_of(name)
    scene.limits = SMOOTH
    keep = slice(0, 6)
    for field in ("means", "quats", "scales", "opacities", "colours"):
        setattr(scene, field, getattr(scene, field)[keep])
    if name == "near lens":  # in front of the camera, so that no step crosses the near plane
        scene.means[:, 2] = scene.means[:, 2].abs() + 0.1
    rng = np.random.default_rng(1)
    height, width = scene.camera.height, scene.camera.width
    a, b = torch.tensor(rng.normal(size=(height, width, 3))), torch.tensor(rng.normal(size=(height, width)))

    def value(tensors: list[torch.Tensor]) -> torch.Tensor:
        render = scene.render(tensors)
        return (a * render.image).sum() + (b * render.alpha).sum()

    tensors = scene.tensors(torch.float64)
    value(tensors).backward()
    for number, tensor in enumerate(tensors):
        direction = torch.tensor(rng.normal(size=tuple(tensor.shape)))
        # Richardson extrapolation of central differences: error of fourth order.
        slopes = []
        for step in (2e-5, 1e-5):
            step *= float(scene.scales.min()) / 0.05 if number == 2 else 1.0
            ends = []
            for sign in (1, -1):
                moved = [t.detach() for t in tensors]
                moved[number] = moved[number] + sign * step * direction
                ends.append(value(moved))
            slopes.append((ends[0] - ends[1]) / (2 * step))
        expected = (4 * slopes[1] - slopes[0]) / 3
        slope = (tensor.grad * direction).sum()
        scale = (tensor.grad * direction).abs().sum()
        assert abs(slope - expected) < 1e-5 * scale + 1e-9, (name, number)


def test_one_gaussian_by_hand() -> None:
    """On the axis of an undistorted camera: alpha and colour at a pixel from the definition."""
    camera = SplatCamera(np.eye(4), fx=50, fy=50, cx=8, cy=8, width=16, height=16)
    values = [
        [[0.0, 0.0, 2.0]],
        [[1.0, 0.0, 0.0, 0.0]],
        [[0.2, 0.1, 0.3]],
        [0.8],
        [[1.0, 2.0, 4.0]],
    ]
    tensors = [torch.tensor(value, dtype=torch.float64) for value in values]
    render = rasterize(*tensors, camera, torch.full((3,), 0.5, dtype=torch.float64))
    x, y = 10.5 - 8, 6.5 - 8
    alpha = 0.8 * np.exp(-0.5 * (x * x / (5.0**2 + 0.1) + y * y / (2.5**2 + 0.1)))
    assert render.alpha[6, 10].item() == pytest.approx(alpha, rel=1e-12)
    expected = alpha * np.array([1, 2, 4]) + (1 - alpha) * 0.5
    np.testing.assert_allclose(render.image[6, 10].numpy(), expected, rtol=1e-12)


def test_a_view_that_shows_no_gaussian_has_gradients_of_zeros() -> None:
    camera = SplatCamera(np.eye(4), fx=50, fy=50, cx=8, cy=8, width=16, height=16)
    behind = [[[0.0, 0.0, -2.0]], [[1.0, 0.0, 0.0, 0.0]], [[0.1, 0.1, 0.1]], [0.5], [[1.0, 1.0, 1.0]]]
    tensors = [torch.tensor(value, dtype=torch.float64, requires_grad=True) for value in behind]
    background = torch.full((3,), 0.25, dtype=torch.float64, requires_grad=True)
    render = rasterize(*tensors, camera, background)
    assert (render.image == 0.25).all()
    assert (render.alpha == 0).all()
    (render.image.sum() + render.alpha.sum()).backward()
    assert all((tensor.grad == 0).all() for tensor in tensors)
    assert background.grad is not None
    assert background.grad.tolist() == 3 * [256.0]


def test_rotations_are_rotations() -> None:
    quats = torch.tensor(np.random.default_rng(0).normal(size=(50, 4)))
    matrices = rotation_matrices(quats * 1e-30)
    eye = torch.eye(3).double().expand(50, 3, 3)
    torch.testing.assert_close(matrices @ matrices.transpose(1, 2), eye)
    torch.testing.assert_close(matrices, rotation_matrices(quats))
    quarter = rotation_matrices(torch.tensor([[1.0, 0, 0, 1.0]]).double())[0]  # 90 degrees about z
    np.testing.assert_allclose(quarter @ torch.tensor([1.0, 0, 0]).double(), [0, 1, 0], atol=1e-15)


def test_distortion_equals_opencv() -> None:
    camera = SplatCamera(np.eye(4), 50, 60, 20, 15, 40, 30, k1=-0.2, k2=0.05, p1=0.01, p2=-0.02)
    points = np.random.default_rng(0).uniform(-0.4, 0.4, (20, 2))
    solid = np.concatenate([points, np.ones((20, 1))], axis=1)
    matrix = np.array([[50, 0, 20], [0, 60, 15], [0, 0, 1.0]])
    lens = np.array([-0.2, 0.05, 0.01, -0.02])
    expected, _ = cv2.projectPoints(solid, np.zeros(3), np.zeros(3), matrix, lens)
    distorted = camera.distort(points) * [50, 60] + [20, 15]
    np.testing.assert_allclose(distorted, expected.reshape(-1, 2), atol=1e-9)


def test_folding_lens_has_a_last_radius() -> None:
    camera = SplatCamera(np.eye(4), 50, 50, 20, 15, 40, 30, k1=-0.5)
    radius = np.sqrt(camera.monotone_radius2)
    assert radius == pytest.approx(np.sqrt(1 / 1.5))
    steps = np.linspace(0, radius, 100)
    distorted = camera.distort(np.stack([steps, 0 * steps], axis=1))[:, 0]
    assert (np.diff(distorted) > 0).all()
    assert camera.distort(np.array([radius * 1.05, 0.0]))[0] < distorted[-1]
    assert replace(camera, k1=0.1).monotone_radius2 == np.inf


def test_bounds_hold_the_image() -> None:
    camera = SplatCamera(np.eye(4), 50, 60, 20, 15, 40, 30, k1=-0.2, k2=0.05, p1=0.01, p2=-0.02)
    u0, u1, v0, v1 = camera.tangent_bounds(0.0)
    edge = camera.distort(np.array([[u0, 0.0], [u1, 0.0], [0.0, v0], [0.0, v1]]))
    pixels = edge * [50, 60] + [20, 15]
    assert pixels[0, 0] <= 0.5
    assert pixels[1, 0] >= 39.5
    assert pixels[2, 1] <= 0.5
    assert pixels[3, 1] >= 29.5
    wide = camera.tangent_bounds(0.3)
    assert wide[1] - wide[0] == pytest.approx(1.3 * (u1 - u0))

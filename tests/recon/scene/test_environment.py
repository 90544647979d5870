"""Light by direction behind the Gaussians: where it is seen, how much of it, and its gradients."""

import cv2
import numpy as np
import pytest
import torch

from recon.data.geometry import project
from recon.scene.environment import Environment, texels
from recon.splat import SplatCamera, rasterize

AXES = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
AXES *= np.sign(np.linalg.det(AXES))
POSE = np.eye(4)
POSE[:3, :3] = cv2.Rodrigues(np.array([0.4, -1.1, 0.3]))[0]
POSE[:3, 3] = 0.2, -0.1, 0.5
PINHOLE = SplatCamera(POSE, 30.0, 31.0, 20.5, 15.0, 40, 30, k1=-0.1, k2=0.02)
FISHEYE = SplatCamera(POSE, 14.0, 14.0, 20.0, 15.0, 40, 30, k1=0.02, fisheye=True)


def smooth(directions: np.ndarray) -> np.ndarray:
    """Light [..., 3] that changes gently over twenty stops, along the axes of a map."""
    x, y, z = np.moveaxis(directions / np.linalg.norm(directions, axis=-1, keepdims=True), -1, 0)
    return 2.0 ** (10 * np.stack([x, y, 0.5 * (z - x)], -1))


def environment(rows: int = 256) -> Environment:
    light = np.log(smooth(texels(rows)))
    return Environment(torch.from_numpy(light).movedim(2, 0).contiguous(), AXES)


def test_texels_lie_where_openexr_has_them() -> None:
    """ImfEnvmap.h: D = (sin(lon) cos(lat), sin(lat), cos(lon) cos(lat)), longitude pi at the left, latitude
    pi / 2 at the top."""
    for row, column in ((0, 0), (3, 5), (7, 15)):
        lat, lon = np.pi / 2 - np.pi * (row + 0.5) / 8, np.pi - 2 * np.pi * (column + 0.5) / 16
        expected = np.sin(lon) * np.cos(lat), np.sin(lat), np.cos(lon) * np.cos(lat)
        np.testing.assert_allclose(texels(8)[row, column], expected, atol=1e-12)


def test_light_comes_from_where_it_was_put_across_the_seam_and_at_the_poles() -> None:
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(500, 3))
    directions[:50] = np.stack([rng.normal(0, 1e-3, 50), rng.normal(size=50), -np.ones(50)], 1)  # the seam
    directions[50:60, [0, 2]] *= 1e-2
    light = environment().light(torch.from_numpy(7 * directions)).numpy()
    np.testing.assert_allclose(light, smooth(directions), rtol=0.03)


@pytest.mark.parametrize("camera", [PINHOLE, FISHEYE])
def test_a_camera_sees_far_points_and_the_environment_at_the_same_pixels(camera: SplatCamera) -> None:
    rows, columns = np.mgrid[1 : camera.height : 4, 1 : camera.width : 4].reshape(2, -1)
    far = environment()
    picture = far.render(camera).numpy()
    centre = -POSE[:3, :3].T @ POSE[:3, 3]
    directions = np.random.default_rng(1).normal(size=(4000, 3))
    pixels, depth = project(camera, centre + 1e9 * directions)
    shown = (depth > 0) & (np.abs(pixels - np.floor(pixels) - 0.5).max(1) < 0.1)
    shown &= ((pixels > 0) & (pixels < (camera.width, camera.height))).all(1)
    assert shown.sum() > 3
    x, y = np.floor(pixels[shown]).astype(int).T
    np.testing.assert_allclose(picture[y, x], smooth(directions[shown] @ AXES.T), rtol=0.12)
    assert np.isfinite(picture[rows, columns]).all()


def scene(dtype: torch.dtype) -> list[torch.Tensor]:
    rng = np.random.default_rng(5)
    inverse = np.linalg.inv(POSE)
    ahead = np.stack([rng.uniform(-0.5, 0.5, 4), rng.uniform(-0.4, 0.4, 4), rng.uniform(1.5, 3, 4)], 1)
    values = (
        ahead @ inverse[:3, :3].T + inverse[:3, 3], rng.normal(size=(4, 4)), rng.uniform(0.1, 0.4, (4, 3)),
        rng.uniform(0.3, 0.95, 4), rng.uniform(0, 2, (4, 3)),
    )  # fmt: skip
    return [torch.from_numpy(value).to(dtype) for value in values]


def behind(tensors: list[torch.Tensor], ln_light: torch.Tensor) -> torch.Tensor:
    render = rasterize(*tensors, PINHOLE)
    return Environment(ln_light, AXES).behind(render.image, render.alpha, PINHOLE)


def test_gaussians_let_through_what_their_transmittance_says() -> None:
    """The reference in float64, with the environment of one light as its background."""
    tensors = scene(torch.float64)
    light = torch.tensor([3.0, 40.0, 2.0**15], dtype=torch.float64)
    ln_light = light.log()[:, None, None].expand(3, 8, 16)
    expected = rasterize(*tensors, PINHOLE, light).image
    torch.testing.assert_close(behind(tensors, ln_light), expected, rtol=1e-9, atol=1e-9)
    fast = behind(scene(torch.float32), ln_light.float())
    torch.testing.assert_close(fast.double(), expected, rtol=2e-4, atol=2e-3)


@pytest.mark.parametrize("part", ["light", "opacities", "means"])
def test_gradients_are_finite_differences(part: str) -> None:
    tensors, ln_light = scene(torch.float64), environment(6).ln_light / 10
    weights = torch.from_numpy(np.random.default_rng(2).normal(size=(30, 40, 3)))
    wanted = {"light": ln_light, "opacities": tensors[3], "means": tensors[0]}[part]
    wanted.requires_grad_(True)
    (weights * behind(tensors, ln_light)).sum().backward()
    assert wanted.grad is not None
    gradient, flat = wanted.grad.reshape(-1), wanted.detach().reshape(-1)
    assert float(gradient.abs().max()) > 0
    for place in np.linspace(0, len(flat) - 1, 9).astype(int).tolist():
        sums = []
        for step in (1e-5, -1e-5):
            flat[place] += step
            with torch.no_grad():
                sums.append(float((weights * behind(tensors, ln_light)).sum()))
            flat[place] -= step
        assert float(gradient[place]) == pytest.approx((sums[0] - sums[1]) / 2e-5, rel=1e-4, abs=1e-5)

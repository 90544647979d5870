"""The code's own thresholds, at the value and one step to each side: both executions decide alike."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch

from recon.splat import Limits, Render, SplatCamera, rasterize
from recon.splat.limits import ALPHA_FLOOR, COLOUR_MOST, QUAT_LEAST

Dot = Callable[..., list[torch.Tensor]]


def beside(value: float) -> list[float]:
    """The float32 below, the value (a float32 itself) and the float32 above."""
    middle = np.float32(value)
    assert float(middle) == value
    return [
        float(np.nextafter(middle, np.float32(-np.inf))),
        value,
        float(np.nextafter(middle, np.float32(np.inf))),
    ]


def visible(tensors: list[torch.Tensor], camera: SplatCamera, limits: Limits) -> tuple[int, int]:
    """(Gaussians seen, Gaussians culled); the gradients are finite, and zero where nothing is seen."""
    render = rasterize(*tensors, camera, limits=limits)
    assert torch.isfinite(render.image).all()
    if render.image.requires_grad:
        render.image.sum().backward()
        for tensor in tensors:
            assert torch.isfinite(tensor.grad).all()
            assert render.visible or not tensor.grad.any()
    assert bool(render.visible) == bool(render.image.any())
    return render.visible, render.culled


def test_near_plane(dot: Dot, axial_camera: SplatCamera, dtype: torch.dtype) -> None:
    near = 2.0**-7
    counts = [
        visible(dot(dtype, depth=depth, scale=1e-4), axial_camera, Limits(near=near))
        for depth in beside(near)
    ]
    assert counts == [(0, 0), (1, 0), (1, 0)]


@pytest.mark.parametrize("light", [1.0, 2.0**10])
def test_alpha_floor(dot: Dot, axial_camera: SplatCamera, dtype: torch.dtype, light: float) -> None:
    """Use any light, and a Gaussian 2^10 brighter than the reference, whose floor is 2^-10 lower."""
    limits = Limits(alpha_min=2.0**-8, luminance_reference=1.0, tau=2.0**-8)
    counts = [
        visible(dot(dtype, opacity=opacity, light=light), axial_camera, limits)
        for opacity in beside(2.0**-8 / light)
    ]
    assert counts == [(0, 0), (1, 0), (1, 0)]


def test_lowest_floor(dot: Dot, axial_camera: SplatCamera, dtype: torch.dtype) -> None:
    limits = Limits(luminance_reference=1e-20)
    counts = [
        visible(dot(dtype, opacity=opacity, light=1e20), axial_camera, limits)
        for opacity in beside(ALPHA_FLOOR)
    ]
    assert counts == [(0, 0), (1, 0), (1, 0)]


def test_largest_alpha(dot: Dot, axial_camera: SplatCamera, dtype: torch.dtype) -> None:
    """At most alpha_max is drawn, on the axis exactly it."""
    limits = Limits(alpha_max=0.75)
    counts = [
        float(rasterize(*dot(dtype, opacity=opacity), axial_camera, limits=limits).alpha[16, 16].detach())
        for opacity in beside(0.75)
    ]
    assert counts[0] < counts[1] == counts[2] == 0.75


def test_least_transmittance(sheets: Callable[..., Render], dtype: torch.dtype) -> None:
    """The layer behind is drawn while what is left is at least t_min; on the axis it is so exactly."""
    limits, lit = Limits(t_min=2.0**-10), []
    for opacity in beside(1 - 2.0**-10):
        image = sheets([2.0, 3.0], [opacity, 1.0], [0.0, 1.0], dtype, limits=limits).image
        assert torch.isfinite(image).all()
        lit.append(bool(image[16, 16].any()))
    assert lit == [True, True, False]


def test_t_min_of_zero_never_stops(sheets: Callable[..., Render], dtype: torch.dtype) -> None:
    render = sheets(
        [2.0 + i for i in range(8)], [1 - 2.0**-12] * 8, [1.0] * 8, dtype, limits=Limits(t_min=0.0)
    )
    remaining = 1 - render.alpha.double()
    assert remaining.min() >= 0
    assert remaining.max() < 1e-7
    assert (render.image - 1).abs().max() < 1e-6


def test_shortest_quaternion(dot: Dot, axial_camera: SplatCamera, dtype: torch.dtype) -> None:
    """One component as large as QUAT_LEAST is a direction, below it there is none."""
    above = np.float32(QUAT_LEAST)
    above = above if float(above) >= QUAT_LEAST else np.nextafter(above, np.float32(1))
    below = np.nextafter(above, np.float32(0))
    for value, expected in ((below, (0, 1)), (above, (1, 0)), (-above, (1, 0)), (np.float32(1e19), (1, 0))):
        tensors = dot(dtype)
        with torch.no_grad():
            tensors[1][:] = torch.tensor([0.0, float(value), 0.0, 0.0])
        assert visible(tensors, axial_camera, Limits()) == expected, value


@pytest.mark.parametrize("sign", [1, -1])
def test_brightest_colour(dot: Dot, axial_camera: SplatCamera, dtype: torch.dtype, sign: int) -> None:
    most = np.float32(COLOUR_MOST)
    most = most if float(most) <= COLOUR_MOST else np.nextafter(most, np.float32(0))
    for value, expected in ((most, (1, 0)), (np.nextafter(most, np.float32(np.inf)), (0, 1))):
        tensors = dot(dtype)
        with torch.no_grad():
            tensors[4][0, 1] = sign * float(value)
        assert visible(tensors, axial_camera, Limits()) == expected, value


def test_largest_deviation(dot: Dot, dtype: torch.dtype) -> None:
    """2^29 px is drawn where that is max_sigma, the next float32 is degenerate."""
    camera = SplatCamera(np.eye(4), fx=16, fy=16, cx=8.5, cy=8.5, width=16, height=16)
    counts = []
    for scale in beside(2.0**26):  # at depth 2: times 8 px
        tensors = dot(dtype, scale=scale)
        with torch.no_grad():
            tensors[2][0, 2] = 1.0
        counts.append(visible(tensors, camera, Limits(max_sigma=2.0**29)))
    assert counts == [(1, 0), (1, 0), (0, 1)]


def test_edge_of_the_clamped_field_of_view(dot: Dot, axial_camera: SplatCamera, dtype: torch.dtype) -> None:
    """Require continuity of the image at the clamp of the Jacobian."""
    limits = Limits(tangent_margin=0.3)
    edge = axial_camera.tangent_bounds(0.3)[1]
    images = []
    for share in (1 - 1e-6, 1 - 1e-7, 1.0, 1 + 1e-7, 1 + 1e-6):
        tensors = dot(dtype, scale=0.5)
        with torch.no_grad():
            tensors[0][0, 0] = 2.0 * edge * share
        render = rasterize(*tensors, axial_camera, limits=limits)
        render.image.sum().backward()
        assert all(torch.isfinite(tensor.grad).all() for tensor in tensors)
        images.append(render.image.detach())
    assert images[2].max() > 0.01
    for image in images:
        assert (image - images[2]).abs().max() < 1e-5


def test_fold_of_the_lens(dot: Dot, dtype: torch.dtype) -> None:
    """At the radius where distortion stops growing a Gaussian is gone, just inside it is drawn."""
    camera = SplatCamera(np.eye(4), fx=20, fy=20, cx=12.5, cy=9.5, width=48, height=18, k1=-0.5)
    radius = math.sqrt(camera.monotone_radius2)
    for share, expected in ((1 - 1e-6, (1, 0)), (1 + 1e-6, (0, 0))):
        tensors = dot(dtype)
        with torch.no_grad():
            tensors[0][0, 0] = 2.0 * radius * share
        assert visible(tensors, camera, Limits()) == expected


def test_limits_refuse_nonsense() -> None:
    wrong: list[dict[str, Any]] = [
        {"alpha_max": 1.5},
        {"alpha_max": 0.0},
        {"alpha_min": -1.0},
        {"t_min": -1.0},
        {"t_min": 1.0},
        {"blur": 0.0},
        {"near": math.nan},
        {"tau": math.inf},
        {"luminance_reference": math.nan},
        {"luminance_reference": 0.0},
    ]
    for options in wrong:
        with pytest.raises(ValueError, match=next(iter(options))):
            Limits(**options)

"""High contrast: what METHODS of 8-bit splatting lose, in both executions."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from recon.splat import Limits, Render, SplatCamera, rasterize

Sheets = Callable[..., Render]
NAMES = ("means", "quats", "scales", "opacities", "colours")


@pytest.mark.parametrize("contrast", [2.0**12, 2.0**20])
@pytest.mark.parametrize("layers", [1, 2, 40, 300])
@pytest.mark.parametrize("behind", ["gaussian", "background"])
def test_bright_plane_does_not_leak_through_a_card(
    sheets: Sheets, dtype: torch.dtype, contrast: float, layers: int, behind: str
) -> None:
    opacity = {1: 1.0, 2: 1.0 - 2.0**-14, 40: 0.6, 300: 0.1}[layers]
    depths = [2.0 + 0.01 * i for i in range(layers)]
    limits = Limits.for_scene(1.0, contrast)
    if behind == "gaussian":
        render = sheets(
            [*depths, 9.0], [opacity] * layers + [1.0], [1.0] * layers + [contrast], dtype, limits=limits
        )
    else:
        background = torch.full((3,), contrast, dtype=dtype)
        render = sheets(
            depths, [opacity] * layers, [1.0] * layers, dtype, limits=limits, background=background
        )
    assert (render.image - 1).abs().max() < 0.01


def test_usual_constants_do_leak(sheets: Sheets) -> None:
    """The test above can fail: with the cut-offs of 8-bit colour the card is lost."""
    render = sheets([2.0, 9.0], [1.0, 1.0], [1.0, 2.0**12], torch.float32, limits=Limits.gsplat())
    assert (render.image - 1).abs().max() > 1


def test_nearly_opaque_layer_leaks_what_it_should(sheets: Sheets, dtype: torch.dtype) -> None:
    """1 - alpha keeps its digits: an opacity of 1 - 2^-22 lets 2^-22 through, not 2^-22 +- 2^-24."""
    render = sheets([2.0, 9.0], [1 - 2.0**-22, 1.0], [0.0, 2.0**22], dtype)
    assert (render.image - 1).abs().max() < 1e-4


def test_complement_of_alpha_keeps_its_digits_off_the_centre(dtype: torch.dtype) -> None:
    """Near the centre of an opaque Gaussian 1 - alpha is tiny: the light behind it, 2^20, shows that."""
    camera = SplatCamera(np.eye(4), fx=200, fy=200, cx=12.5, cy=9.5, width=24, height=18)
    values = [[[0.0, 0.0, 2.0]], [[1.0, 0, 0, 0]], [[40.0, 40.0, 1.0]], [1.0], [[0.0] * 3]]
    tensors = [torch.tensor(value, dtype=dtype) for value in values]
    image = rasterize(*tensors, camera, torch.full((3,), 2.0**20, dtype=dtype)).image[..., 0].double()
    rows, columns = torch.meshgrid(torch.arange(18.0), torch.arange(24.0), indexing="ij")
    squared = ((rows - 9) ** 2 + (columns - 12) ** 2).double() / (200 * 40 / 2.0) ** 2
    expected = -(2.0**20) * torch.expm1(-0.5 * squared)
    assert image[9, 12] < 1e-9
    lit = expected > 0
    assert ((image - expected).abs()[lit] / expected[lit]).max() < 1e-4


def test_layer_that_crosses_the_cut_off_counts(sheets: Sheets, dtype: torch.dtype) -> None:
    limits = Limits(t_min=1e-2)
    render = sheets([2.0, 3.0, 4.0], [0.5, 0.999, 0.9], [1.0, 3.0, 1e6], dtype, limits=limits)
    assert (render.image / (0.5 + 0.5 * 0.999 * 3.0) - 1).abs().max() < 1e-5
    assert (render.alpha - (1 - 0.5 * 0.001)).abs().max() < 1e-6


def test_cut_off_of_a_scene_is_a_hundredth_of_its_dimmest(sheets: Sheets, dtype: torch.dtype) -> None:
    """Bound the light behind a finished pixel: the brightest adds at most 1 % of 1."""
    contrast = 2.0**20
    limits = Limits.for_scene(1.0, contrast)
    assert limits.t_min <= 1e-8
    worst = 0.0
    for through in np.geomspace(limits.t_min * 0.3, limits.t_min * 3, 9):
        each = 1 - through**0.25  # four layers
        depths, layers = [2.0, 3.0, 4.0, 5.0, 9.0], [each] * 4 + [1.0]
        render = sheets(depths, layers, [0.0] * 4 + [contrast], dtype, limits=limits)
        whole = sheets(depths, layers, [0.0] * 4 + [contrast], dtype, limits=replace(limits, t_min=0.0))
        worst = max(worst, float((render.image - whole.image).abs().max()))
    assert 0 < worst <= 0.01


@pytest.mark.parametrize("pull", ["log", "relative"])
def test_twelve_decades_in_one_image(decades: Any, pull: str) -> None:
    """Each pixel and each Gaussian's own gradient is right by itself, not only their sum."""
    signs = torch.tensor(np.random.default_rng(5).normal(size=(28, 96, 3)))
    images, grads = [], []
    for dtype in (torch.float32, torch.float64):
        tensors = decades.tensors(dtype)
        image = decades.render(tensors).image
        if pull == "log":
            torch.log(image + 1e-6).sum().backward()
        else:  # a residual in units of the pixel itself, of either sign
            image.backward((signs / (image.detach().double() + 1e-6)).to(dtype))
        images.append(image.detach().double())
        grads.append([t.grad.double() for t in tensors])
    ours, truth = images
    lit = truth > 0
    assert truth.max() > 1e12 * truth[lit].min()
    assert truth[lit].log10().quantile(0.9) - truth[lit].log10().quantile(0.1) > 8
    small(((ours - truth).abs()[lit] / truth[lit]).numpy(), "image")
    for name, first, second in zip(NAMES, *grads, strict=True):
        a, b = first.reshape(len(first), -1), second.reshape(len(second), -1)
        norm = b.norm(dim=1)
        small(((a - b).norm(dim=1)[norm > 0] / norm[norm > 0]).numpy(), name)


def small(error: np.ndarray, name: str) -> None:
    assert len(error) > 50, name
    assert np.median(error) <= 1e-5, name
    assert np.quantile(error, 0.99) <= 1e-3, name


def test_dim_layer_between_bright_ones_keeps_its_gradient(dtype: torch.dtype) -> None:
    """A card at 1 between a faint veil and a plane, both at 2^20: the slopes by hand."""
    depths, opacities, light = [2.0, 3.0, 9.0], [2.0**-12, 1 - 2.0**-20, 1.0], [2.0**20, 1.0, 2.0**20]
    means = torch.tensor([[0.0, 0.0, z] for z in depths], dtype=dtype)
    quats = torch.tensor([[1.0, 0, 0, 0]] * 3, dtype=dtype)
    scales = torch.tensor([[1e6, 1e6, 1e-3]] * 3, dtype=dtype)
    alphas = torch.tensor(opacities, dtype=dtype, requires_grad=True)
    colours = torch.tensor([[x] * 3 for x in light], dtype=dtype, requires_grad=True)
    camera = SplatCamera(np.eye(4), fx=20, fy=20, cx=0.5, cy=0.5, width=1, height=1)
    limits = Limits.for_scene(1.0, 2.0**20)
    rasterize(means, quats, scales, alphas, colours, camera, limits=limits).image[0, 0, 0].backward()
    a, b, c = opacities
    weights = torch.tensor([a, (1 - a) * b, (1 - a) * (1 - b) * c], dtype=torch.float64)
    np.testing.assert_allclose(colours.grad[:, 0].double(), weights, rtol=2e-6)
    slopes = [light[0] - b * light[1] - (1 - b) * light[2], (1 - a) * (1 - light[2])]
    np.testing.assert_allclose(alphas.grad[:2].double(), slopes, rtol=2e-6)


def test_floor_follows_luminance(dot: Any, axial_camera: SplatCamera, dtype: torch.dtype) -> None:
    """Bound what is cut off a bright Gaussian by tau times the reference; without it, it is larger."""

    def image(dtype: torch.dtype, limits: Limits) -> torch.Tensor:
        tensors = dot(dtype, opacity=0.9, light=1e6)
        return rasterize(*tensors, axial_camera, limits=limits).image.detach().double()

    whole = image(torch.float64, Limits(alpha_min=1e-18))
    aware = image(dtype, Limits(luminance_reference=1.0, tau=1e-3))
    cut = (aware == 0) & (whole > 0)
    assert cut.any()
    assert whole[cut].max() < 1e-3 * 1.01
    plain = image(dtype, Limits())
    assert whole[(plain == 0) & (whole > 0)].max() > 1e2


def test_floor_never_rises_above_the_usual_one(
    dot: Any, axial_camera: SplatCamera, dtype: torch.dtype
) -> None:
    """A Gaussian dimmer than the reference is cut off where any is, not nearer."""
    tensors = dot(dtype, light=1e-9)
    plain = rasterize(*tensors, axial_camera)
    aware = rasterize(*tensors, axial_camera, limits=Limits(luminance_reference=1.0))
    assert torch.equal(plain.image, aware.image)


def test_opacity_above_the_largest_alpha_keeps_its_gradient(scene_of: Any, dtype: torch.dtype) -> None:
    scene = scene_of("plain")
    scene.limits = replace(scene.limits, alpha_max=0.75)
    scene.opacities[3:6] = torch.tensor([0.75, 0.9, 1.5])
    results = []
    for opacities in (scene.opacities, scene.opacities.clamp(max=0.75)):
        scene.opacities = opacities
        tensors = scene.tensors(dtype)
        render = scene.render(tensors)
        render.image.sum().backward()
        results.append((render.image.detach(), tensors[3].grad))
    assert torch.equal(results[0][0], results[1][0])
    assert torch.equal(results[0][1], results[1][1])
    assert results[0][1][3:6].any()

"""Gaussians drawn at distances and widths that they were not trained at."""

from dataclasses import replace
from math import log

import numpy as np
import pytest
import torch

from recon.data.geometry import inside, project
from recon.scene.appearance import PlainHarmonics
from recon.scene.gaussians import Gaussians, Renderer, limits_for
from recon.scene.sampling import Sampling, away_from, spacing_of
from recon.splat import SplatCamera

WIDTH = 256
CAMERA = SplatCamera(np.eye(4), fx=200, fy=200, cx=WIDTH / 2, cy=WIDTH / 2, width=WIDTH, height=WIDTH)
LENSES = {
    "pinhole": CAMERA,
    "bowed": replace(CAMERA, k1=0.1, k2=0.02, p1=1e-3),
    "fisheye": replace(CAMERA, fisheye=True, k1=0.05),
}


@pytest.fixture(params=LENSES)
def camera(request: pytest.FixtureRequest) -> SplatCamera:
    return LENSES[request.param]


def resized(camera: SplatCamera, factor: float) -> SplatCamera:
    sizes = {name: factor * getattr(camera, name) for name in ("fx", "fy", "cx", "cy")}
    return replace(camera, width=round(factor * camera.width), height=round(factor * camera.height), **sizes)


def moved_back(camera: SplatCamera, distance: float) -> SplatCamera:
    motion = camera.cam_from_world.copy()
    motion[2, 3] += distance
    return replace(camera, cam_from_world=motion)


def scattered(sigma: float, opacity: float = 0.05, count: int = 300, spread: float = 1.2) -> Gaussians:
    """Flat white Gaussians two units ahead, of `sigma` px at the width of CAMERA, thin along one axis."""
    generator = torch.Generator().manual_seed(8)
    means = torch.rand(count, 3, generator=generator) - 0.5
    means = spread * means * torch.tensor([1.0, 1.0, 0.0]) + torch.tensor([0.0, 0.0, 2.0])
    scales = sigma * 2 / CAMERA.fx * torch.tensor([1.0, 0.7, 0.2])
    return Gaussians(
        {
            "means": means,
            "quats": torch.randn(count, 4, generator=generator),
            "log_scales": scales.log().expand(count, 3).clone(),
            "opacity_logits": torch.full((count,), log(opacity / (1 - opacity))),
            **PlainHarmonics().start(torch.ones(count, 3)),
        }
    )


def drawn(gaussians: Gaussians, camera: SplatCamera, trained: SplatCamera | None) -> torch.Tensor:
    """[H, W], as drawn by what was trained with one camera, or where None is said of that."""
    sampling = None if trained is None else Sampling.of(gaussians.parameters["means"], [trained])
    renderer = Renderer(PlainHarmonics(), limits_for(1e-6), sampling=sampling)
    with torch.no_grad():
        return renderer(gaussians, camera, degree=0).image[..., 0].double()


def light(image: torch.Tensor) -> float:
    return float(image.sum())


def test_what_was_trained_looks_as_it_did(camera: SplatCamera) -> None:
    gaussians = scattered(0.5)
    cameras = [camera, moved_back(camera, 1.0)]
    sampling = Sampling.of(gaussians.parameters["means"], cameras)
    renderer = Renderer(PlainHarmonics(), limits_for(1e-6), sampling=sampling)
    for place in (*cameras, moved_back(camera, 0.5)):
        image = renderer(gaussians, place, degree=0).image
        assert torch.equal(image, replace(renderer, sampling=None)(gaussians, place, degree=0).image)
        assert image.max() > 0.01


@pytest.mark.parametrize("factor", [0.5, 0.25, 2.0, 4.0])
def test_another_width_holds_the_same_light(camera: SplatCamera, factor: float) -> None:
    """Keep the thickness of what is smaller than a pixel in small and large pictures."""
    gaussians = scattered(0.3, opacity=0.1, count=800)
    whole = light(drawn(gaussians, camera, camera))
    other = resized(camera, factor)
    assert light(drawn(gaussians, other, camera)) / factor**2 == pytest.approx(whole, rel=0.02)
    assert light(drawn(gaussians, other, None)) / factor**2 != pytest.approx(whole, rel=0.2)


@pytest.mark.parametrize("distance", [4.0, -1.2])
def test_another_distance_holds_the_same_light(camera: SplatCamera, distance: float) -> None:
    gaussians = scattered(0.3, opacity=0.1, spread=0.2)
    factor = 2 / (2 + distance)
    whole = light(drawn(gaussians, camera, camera))
    other = moved_back(camera, distance)
    assert light(drawn(gaussians, other, camera)) / factor**2 == pytest.approx(whole, rel=0.03)
    assert light(drawn(gaussians, other, None)) / factor**2 != pytest.approx(whole, rel=0.2)


def test_a_larger_picture_has_the_same_shapes() -> None:
    """The standard deviation of a Gaussian, in its own picture, is the trained one times the width."""
    gaussians = scattered(0.2, opacity=0.5, count=1, spread=0.0)

    def deviation(image: torch.Tensor) -> float:
        places = torch.arange(image.shape[1], dtype=torch.float64) + 0.5
        weights = image.sum(0) / image.sum()
        mean = (weights * places).sum()
        return float((weights * (places - mean) ** 2).sum().sqrt())

    # Four times the width is measured by its samples well; the trained one is known: 0.1 px^2 and its own.
    gaussians.parameters["quats"] = torch.tensor([[1.0, 0, 0, 0]])
    large = deviation(drawn(gaussians, resized(CAMERA, 4), CAMERA))
    assert large == pytest.approx(4 * np.sqrt(0.2**2 + 0.1), rel=1e-3)
    assert deviation(drawn(gaussians, resized(CAMERA, 4), None)) < 0.7 * large


def test_a_wall_stays_opaque_from_far_away() -> None:
    """Opacity falls only by what blur takes of a Gaussian: none of one that is wide."""
    gaussians = scattered(40.0, opacity=0.999, count=40, spread=0.5)
    small = drawn(gaussians, resized(CAMERA, 0.25), CAMERA)
    assert small[28:36, 28:36].min() > 0.999


def test_the_range_is_that_of_the_views_that_see_a_gaussian(camera: SplatCamera) -> None:
    """Against projections of `recon.data.geometry` and the spacing that is drawn with."""
    generator = torch.Generator().manual_seed(2)
    means = 4 * (torch.rand(6000, 3, generator=generator) - 0.5)
    cameras = [camera, moved_back(camera, 1.5), resized(moved_back(camera, 0.7), 0.3)]
    least, most = torch.full((6000,), torch.inf), torch.zeros(6000)
    certain = torch.ones(6000, dtype=torch.bool)
    for one in cameras:
        pixels, depth = project(one, means.double().numpy())
        visible = torch.from_numpy(inside(one, pixels, depth))
        centre = np.array([one.width, one.height]) / 2
        # A bowed picture's field of view is taken as a rectangle, a fisheye's as a circle.
        border = np.abs(pixels - centre).max(axis=1) > 0.8 * one.width / 2
        certain &= torch.from_numpy(~border | (depth <= 0))
        spacing = spacing_of(away_from(means, one), one)
        least = torch.where(visible, torch.minimum(least, spacing), least)
        most = torch.where(visible, torch.maximum(most, spacing), most)
    sampling = Sampling.of(means, cameras)
    known = certain & (most > 0)
    assert known.sum() > 100
    torch.testing.assert_close(sampling.least[known], least[known], rtol=2e-4, atol=0)
    torch.testing.assert_close(sampling.most[known], most[known], rtol=2e-4, atol=0)
    unseen = certain & (most == 0)
    assert unseen.sum() > 100
    assert (sampling.least[unseen] == 0).all()
    assert sampling.most[unseen].isinf().all()


def test_what_no_view_saw_is_drawn_as_it_is() -> None:
    gaussians = scattered(0.3)
    turned = np.diag([-1.0, 1.0, -1.0, 1.0])
    behind = replace(CAMERA, cam_from_world=turned)
    small = resized(CAMERA, 0.5)
    assert torch.equal(drawn(gaussians, small, behind), drawn(gaussians, small, None))


def test_bad_gaussians_are_left_out_as_ever() -> None:
    gaussians = scattered(0.3)
    parameters = {name: value.clone() for name, value in gaussians.parameters.items()}
    parameters["means"][0] = torch.nan
    parameters["means"][1] = torch.inf
    parameters["quats"][2] = 0
    parameters["log_scales"][3] = 90.0
    parameters["log_scales"][4] = -torch.inf
    good = Gaussians({name: value[5:] for name, value in parameters.items()})
    for factor in (0.25, 4.0):
        small = resized(CAMERA, factor)
        image = drawn(Gaussians(parameters), small, CAMERA)
        assert image.isfinite().all()
        torch.testing.assert_close(image, drawn(good, small, CAMERA), rtol=0, atol=1e-6)


@pytest.mark.parametrize("distance", [-1.5, 0.0, 6.0])
def test_without_gradient_the_kernel_draws_what_torch_does(camera: SplatCamera, distance: float) -> None:
    gaussians = scattered(0.8)
    parameters = gaussians.parameters
    sampling = Sampling.of(parameters["means"], [camera, moved_back(camera, 1.0)])
    place = moved_back(camera, distance)
    given = (
        away_from(parameters["means"], place),
        gaussians.scales(),
        parameters["quats"],
        gaussians.opacities(),
    )
    expected = sampling.drawn(*given, place, 0.1)
    with torch.no_grad():
        drawn = sampling.drawn(*given, place, 0.1)
    for one, other in zip(drawn, expected, strict=True):
        torch.testing.assert_close(one, other, rtol=2e-5, atol=0)
    changed = [not torch.equal(one, before) for one, before in zip(drawn, (given[1], given[3]), strict=True)]
    assert changed == [distance < 0, distance > 1]

"""High contrast, bad values and degenerate shapes, in both executions."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from recon.splat import Limits, Render, SplatCamera, rasterize

DTYPES = [torch.float32, torch.float64]
CAMERA = SplatCamera(np.eye(4), fx=20, fy=20, cx=12, cy=9, width=24, height=18)


def sheets(
    depths: list[float], opacities: list[float], light: list[float], dtype: torch.dtype, **options: Any
) -> Render:
    """Gaussians so wide that the image sees them as planes of one opacity."""
    n = len(depths)
    means = torch.tensor([[0.0, 0.0, z] for z in depths], dtype=dtype)
    quats = torch.tensor([[1.0, 0, 0, 0]] * n, dtype=dtype)
    scales = torch.tensor([[1e6, 1e6, 1e-3]] * n, dtype=dtype)
    colours = torch.tensor([[x] * 3 for x in light], dtype=dtype)
    return rasterize(means, quats, scales, torch.tensor(opacities, dtype=dtype), colours, CAMERA, **options)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("contrast", [2.0**12, 2.0**20])
@pytest.mark.parametrize("layers", [1, 2, 40, 300])
@pytest.mark.parametrize("behind", ["gaussian", "background"])
def test_bright_plane_does_not_leak_through_a_card(
    dtype: torch.dtype, contrast: float, layers: int, behind: str
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


def test_usual_constants_do_leak() -> None:
    """The test above can fail: with the cut-offs of 8-bit colour the card is lost."""
    render = sheets([2.0, 9.0], [1.0, 1.0], [1.0, 2.0**12], torch.float32, limits=Limits.gsplat())
    assert (render.image - 1).abs().max() > 1


@pytest.mark.parametrize("dtype", DTYPES)
def test_nearly_opaque_layer_leaks_what_it_should(dtype: torch.dtype) -> None:
    """1 - alpha keeps its digits: an opacity of 1 - 2^-22 lets 2^-22 through, not 2^-22 +- 2^-24."""
    render = sheets([2.0, 9.0], [1 - 2.0**-22, 1.0], [0.0, 2.0**22], dtype)
    assert (render.image - 1).abs().max() < 1e-4


@pytest.mark.parametrize("dtype", DTYPES)
def test_layer_that_crosses_the_cut_off_counts(dtype: torch.dtype) -> None:
    limits = Limits(t_min=1e-2)
    render = sheets([2.0, 3.0, 4.0], [0.5, 0.999, 0.9], [1.0, 3.0, 1e6], dtype, limits=limits)
    assert (render.image / (0.5 + 0.5 * 0.999 * 3.0) - 1).abs().max() < 1e-5
    assert (render.alpha - (1 - 0.5 * 0.001)).abs().max() < 1e-6


def test_gradient_behind_a_bright_layer(scene_of: Any) -> None:
    """Twelve decades of radiance: each Gaussian's own gradient is right, not only their sum."""
    scene = scene_of("bright")
    grads = []
    for dtype in DTYPES:
        tensors = scene.tensors(dtype)
        image = scene.render(tensors).image
        torch.log(image + 1e-6).sum().backward()
        grads.append([t.grad.double() for t in tensors])
    for name, ours, theirs in zip(("means", "quats", "scales", "opacities", "colours"), *grads, strict=True):
        a, b = ours.reshape(len(ours), -1), theirs.reshape(len(theirs), -1)
        norm = b.norm(dim=1)
        seen = norm > 0
        error = ((a - b).norm(dim=1)[seen] / norm[seen]).numpy()
        assert np.median(error) < 1e-5, name
        assert np.quantile(error, 0.99) < 1e-3, name


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("power", [-20, -7, 1, 20])
def test_radiance_scales_exactly(scene_of: Any, dtype: torch.dtype, power: int) -> None:
    scene = scene_of("bright")
    scene.background = torch.tensor([0.25, 3.0, 1e-3]).double()
    render = scene.render(scene.tensors(dtype, grad=False))
    factor = 2.0**power
    scene.colours, scene.background = scene.colours * factor, scene.background * factor
    scene.limits = replace(scene.limits, luminance_reference=1e-6 * factor)
    scaled = scene.render(scene.tensors(dtype, grad=False))
    assert torch.equal(scaled.alpha, render.alpha)
    assert torch.equal(scaled.image, render.image * factor)


def test_floor_follows_luminance() -> None:
    """What is cut off a bright Gaussian is dimmer than tau times the reference; without it, it is not."""
    means, quats = torch.tensor([[0.0, 0, 2.0]]).double(), torch.tensor([[1.0, 0, 0, 0]]).double()
    scales, opacity = torch.full((1, 3), 0.1).double(), torch.tensor([0.9]).double()
    light = torch.full((1, 3), 1e6).double()

    def image(dtype: torch.dtype, limits: Limits) -> torch.Tensor:
        tensors = [t.to(dtype) for t in (means, quats, scales, opacity, light)]
        return rasterize(*tensors, CAMERA, limits=limits).image.double()

    whole = image(torch.float64, Limits(alpha_min=1e-18))
    for dtype in DTYPES:
        aware = image(dtype, Limits(luminance_reference=1.0, tau=1e-3))
        cut = (aware == 0) & (whole > 0)
        assert cut.any()
        assert whole[cut].max() < 1e-3 * 1.01
        plain = image(dtype, Limits())
        assert whole[(plain == 0) & (whole > 0)].max() > 1e2


BAD = [math.nan, math.inf, -math.inf]
POISON = {
    "means": [*BAD, 3e38, -3e38, 1e-45],
    "quats": [*BAD, 3e38, 1e-45, 1e-30],
    "scales": [*BAD, 0.0, -1.0, 1e-45, 1e-30, 1e19, 3e38],
    "opacities": [*BAD, 0.0, -0.5, 1e-45, 1.0, 1.5, 3e38, 1.0 / 255.0],
    "colours": [*BAD, 3e30, -1.0, 1e-45],
}
CULLED = {
    "means": lambda v, whole: False,
    "quats": lambda v, whole: whole and v < 1e-20,
    "scales": lambda v, whole: v <= 0 or v > 1e9,
    "opacities": lambda v, whole: v < 0,
    "colours": lambda v, whole: False,
}
"""Which finite values are degenerate, in one component or in all; those that are not finite always are."""


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("field", list(POISON))
def test_poison_is_culled_and_counted(scene_of: Any, field: str, dtype: torch.dtype) -> None:
    names = ("means", "quats", "scales", "opacities", "colours")
    scene = scene_of("plain")
    if dtype == torch.float64:  # the oracle is slow: fewer Gaussians and pixels
        for name in names:
            setattr(scene, name, getattr(scene, name)[:12])
        scene.camera = replace(scene.camera, width=12, height=10, fx=10.0, fy=10.0, cx=6.0, cy=5.0)
    victim = 7
    scene.means[victim] = torch.tensor([0.1, 0.05, 0.0])  # in the middle of the image
    clean = scene.tensors(dtype, grad=False)
    rest = [torch.cat([t[:victim], t[victim + 1 :]]) for t in clean]
    without = scene.render(rest)
    for value in POISON[field]:
        for whole in (False, True):
            tensors = scene.tensors(dtype)
            with torch.no_grad():
                row = tensors[names.index(field)][victim : victim + 1]
                if whole:
                    row[...] = value
                else:
                    row.reshape(-1)[0] = value
            render = scene.render(tensors)
            assert torch.isfinite(render.image).all(), (value, whole)
            assert torch.isfinite(render.alpha).all(), (value, whole)
            render.image.clamp(max=1e6).sum().backward()
            assert all(torch.isfinite(t.grad).all() for t in tensors), (value, whole)
            if not math.isfinite(value) or CULLED[field](value, whole):
                assert render.culled == 1, (value, whole)
                assert torch.equal(render.image, without.image), (value, whole)
                assert not any(t.grad[victim].any() for t in tensors), (value, whole)
            else:
                assert render.culled == 0, (value, whole)


@pytest.mark.parametrize("dtype", DTYPES)
def test_zero_quaternion_is_culled(scene_of: Any, dtype: torch.dtype) -> None:
    scene = scene_of("plain")
    scene.quats[5] = 0
    tensors = scene.tensors(dtype)
    render = scene.render(tensors)
    render.image.sum().backward()
    assert render.culled == 1
    assert all(torch.isfinite(t.grad).all() for t in tensors)


def test_needles_of_any_length(scene_of: Any) -> None:
    scene = scene_of("needles")
    for length in (1e3, 1e5, 1e7):
        scene.scales[:, 0], scene.scales[:, 1] = length, length * 1e-9
        tensors = scene.tensors(torch.float32)
        render = scene.render(tensors)
        truth = scene.render(scene.tensors(torch.float64))
        assert render.culled == truth.culled
        assert (render.image.double() - truth.image).abs().median() < 1e-4
        render.image.sum().backward()
        assert all(torch.isfinite(t.grad).all() for t in tensors)


def test_order_of_gaussians_changes_nothing(scene_of: Any) -> None:
    scene = scene_of("many")
    order = torch.tensor(np.random.default_rng(0).permutation(len(scene.means)))
    first, second = scene.tensors(torch.float32), scene.tensors(torch.float32)
    a = scene.render(first)
    with torch.no_grad():
        second = [t[order].requires_grad_() for t in second]
    b = scene.render(second)
    assert torch.equal(a.image, b.image)
    a.image.square().sum().backward()
    b.image.square().sum().backward()
    assert all(torch.equal(x.grad[order], y.grad) for x, y in zip(first, second, strict=True))


def test_rigid_motion_of_the_world_changes_nothing(scene_of: Any) -> None:
    scene = scene_of("lens")
    render = scene.render(scene.tensors(torch.float32, grad=False))
    angle = 0.7
    spin = torch.tensor(
        [[math.cos(angle), -math.sin(angle), 0], [math.sin(angle), math.cos(angle), 0], [0, 0, 1]]
    ).double()
    motion = np.eye(4)
    motion[:3, :3], motion[:3, 3] = spin.numpy(), (3.0, -2.0, 1.0)
    w, x, y, z = scene.quats.unbind(1)
    c, s = math.cos(angle / 2), math.sin(angle / 2)
    scene.quats = torch.stack([c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w], dim=1)
    scene.means = scene.means @ spin.T + torch.tensor(motion[:3, 3])
    scene.camera = replace(scene.camera, cam_from_world=scene.camera.cam_from_world @ np.linalg.inv(motion))
    moved = scene.render(scene.tensors(torch.float32, grad=False))
    error = (moved.image - render.image).abs()
    assert error.mean() < 1e-5
    assert error.median() < 1e-5


def test_long_thin_image_and_a_million_gaussians() -> None:
    n = 1_000_000
    rng = np.random.default_rng(0)
    camera = SplatCamera(np.eye(4), fx=3000, fy=3000, cx=2048, cy=8, width=4096, height=16)
    means = np.stack([rng.uniform(-0.7, 0.7, n), rng.uniform(-0.01, 0.01, n), rng.uniform(0.9, 1.1, n)], 1)
    tensors = [
        torch.tensor(means, dtype=torch.float32),
        torch.tensor([[1.0, 0, 0, 0]]).expand(n, 4).contiguous(),
        torch.full((n, 3), 3e-4),
        torch.full((n,), 0.1),
        torch.full((n, 3), 0.5),
    ]
    render = rasterize(*tensors, camera)
    assert render.image.shape == (16, 4096, 3)
    assert torch.isfinite(render.image).all()
    # Every colour is 0.5, so the image is 0.5 alpha whatever the order.
    torch.testing.assert_close(render.image[..., 0], 0.5 * render.alpha, rtol=1e-4, atol=1e-5)
    assert render.alpha[8].mean() > 0.5


@pytest.mark.parametrize("dtype", DTYPES)
def test_opacity_above_the_largest_alpha_keeps_its_gradient(scene_of: Any, dtype: torch.dtype) -> None:
    scene = scene_of("plain")
    scene.limits = replace(scene.limits, alpha_max=0.75)
    scene.opacities[3:6] = torch.tensor([0.75, 0.9, 1.5])
    found = []
    for opacities in (scene.opacities, scene.opacities.clamp(max=0.75)):
        scene.opacities = opacities
        tensors = scene.tensors(dtype)
        render = scene.render(tensors)
        render.image.sum().backward()
        found.append((render.image.detach(), tensors[3].grad))
    assert torch.equal(found[0][0], found[1][0])
    assert torch.equal(found[0][1], found[1][1])
    assert found[0][1][3:6].any()


@pytest.mark.parametrize("dtype", DTYPES)
def test_nothing_is_folded_back_into_the_image(dtype: torch.dtype) -> None:
    """Beyond the radius where distortion stops growing, the polynomial would put Gaussians in the image."""
    camera = SplatCamera(np.eye(4), fx=20, fy=20, cx=12, cy=9, width=24, height=18, k1=-0.5)
    outside = np.array([1.2, 0.0])
    assert 0 < camera.distort(outside)[0] * 20 + 12 < 24
    for tangent, seen in ((1.2, 0), (0.3, 1)):
        tensors = [
            torch.tensor([[2 * tangent, 0.0, 2.0]], dtype=dtype),
            torch.tensor([[1.0, 0.0, 0.0, 0.0]], dtype=dtype),
            torch.full((1, 3), 0.05, dtype=dtype),
            torch.full((1,), 0.9, dtype=dtype),
            torch.ones(1, 3, dtype=dtype),
        ]
        render = rasterize(*tensors, camera)
        assert render.visible == seen
        assert render.culled == 0
        assert bool(render.image.any()) == bool(seen)


def test_limits_refuse_nonsense() -> None:
    for options in ({"alpha_max": 1.5}, {"t_min": -1.0}, {"blur": 0.0}, {"luminance_reference": math.nan}):
        with pytest.raises(ValueError, match=next(iter(options))):
            Limits(**options)

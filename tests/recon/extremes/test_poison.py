"""Bad values and degenerate shapes fed into every input."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from imaging.errors import InputError
from recon.splat import SplatCamera, rasterize

NAMES = ("means", "quats", "scales", "opacities", "colours")
VALUES = [math.nan, math.inf, -math.inf, 0.0, -0.0, 1.0, -1.0, 1e-45, -1e-45, 1.2e-38, 1e-30, 1e-20]
VALUES += [
    1e-8,
    1e-6,
    1 / 255,
    1 - 2.0**-24,
    1 + 2.0**-23,
    1.5,
    88.8,
    1e4,
    1e7,
    2e11,
    1e19,
    -1e19,
    3e38,
    -3e38,
]


def degenerate(field: str, value: float, whole: bool) -> bool:
    """Return whether a Gaussian with this in one component, or in all, is culled; those not finite always
    are.
    """
    if not math.isfinite(value):
        return True
    if field == "quats":
        return whole and abs(value) < 1e-20
    if field == "scales":  # 1e11 is more than 1e9 px
        return value <= 0 or value >= 1e11
    if field == "colours":
        return abs(value) > 1e30
    return field == "opacities" and value < 0


def small(scene: Any, dtype: torch.dtype) -> Any:
    """Scene of twelve Gaussians and few pixels for the oracle, which is slow; the victim in the middle."""
    if dtype == torch.float64:
        for name in NAMES:
            setattr(scene, name, getattr(scene, name)[:12])
        scene.camera = replace(scene.camera, width=12, height=10, fx=10.0, fy=10.0, cx=6.0, cy=5.0)
    scene.means[VICTIM] = torch.tensor([0.1, 0.05, 0.0])
    return scene


VICTIM = 7


@pytest.mark.parametrize("field", NAMES)
def test_poison_is_culled_and_counted(scene_of: Any, field: str, dtype: torch.dtype) -> None:
    scene = small(scene_of("plain"), dtype)
    clean = scene.tensors(dtype, grad=False)
    without = scene.render([torch.cat([t[:VICTIM], t[VICTIM + 1 :]]) for t in clean])
    for value in VALUES:
        for whole in (False, True):
            tensors = scene.tensors(dtype)
            with torch.no_grad():
                row = tensors[NAMES.index(field)][VICTIM : VICTIM + 1]
                if whole:
                    row[...] = value
                else:
                    row.reshape(-1)[0] = value
            render = scene.render(tensors)
            assert torch.isfinite(render.image).all(), (value, whole)
            assert torch.isfinite(render.alpha).all(), (value, whole)
            assert ((render.alpha >= 0) & (render.alpha <= 1)).all(), (value, whole)
            render.image.clamp(-1e6, 1e6).sum().backward()
            assert all(torch.isfinite(t.grad).all() for t in tensors), (value, whole)
            stored = float(torch.tensor(value, dtype=dtype))  # what is left of it in float32
            if degenerate(field, stored, whole):
                assert render.culled == 1, (value, whole)
                assert torch.equal(render.image, without.image), (value, whole)
                assert not any(t.grad[VICTIM].any() for t in tensors), (value, whole)
            else:
                assert render.culled == 0, (value, whole)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_background_that_is_not_finite_is_refused(scene_of: Any, dtype: torch.dtype, value: float) -> None:
    """It is no Gaussian that could be left out: every pixel that sees it would be lost."""
    scene = scene_of("background")
    scene.background = torch.tensor([0.1, value, 0.2]).double()
    with pytest.raises(InputError, match="background is not finite"):
        scene.render(scene.tensors(dtype))


@pytest.mark.parametrize("value", [0.0, -0.0, -1.0, 1e-45, 1e-30, 1e19, 1e30])
def test_background_of_any_finite_value(scene_of: Any, dtype: torch.dtype, value: float) -> None:
    scene = scene_of("one")
    scene.background = torch.full((3,), value).double()
    tensors = scene.tensors(dtype)
    render = scene.render(tensors)
    image = render.image.detach()
    expected = (1 - render.alpha.detach())[..., None] * tensors[5].detach()
    assert torch.isfinite(image).all()
    assert torch.equal(image[render.alpha == 0], expected[render.alpha == 0])
    render.image.sum().backward()
    assert all(torch.isfinite(t.grad).all() for t in tensors)


@pytest.mark.parametrize("field", ["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"])
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_camera_that_is_not_finite_is_refused(scene_of: Any, field: str, value: float) -> None:
    camera = scene_of("lens").camera
    with pytest.raises(InputError, match=field):
        replace(camera, **{field: value})
    pose = camera.cam_from_world.copy()
    pose[1, 3] = value
    with pytest.raises(InputError, match="cam_from_world"):
        replace(camera, cam_from_world=pose)


def test_camera_without_pixels_or_focal_length_is_refused(scene_of: Any) -> None:
    camera = scene_of("lens").camera
    for field, value in (("fx", 0.0), ("fy", -3.0), ("width", 0), ("height", -1)):
        with pytest.raises(InputError, match=field):
            replace(camera, **{field: value})


@pytest.mark.parametrize("part", ["image", "alpha"])
def test_poisoned_loss_stays_with_the_pixels_it_came_from(scene_of: Any, part: str) -> None:
    """A loss that is not finite at a pixel spoils the Gaussians that touch it, and no others."""
    scene = scene_of("small")
    tensors = scene.tensors(torch.float32)
    render = scene.render(tensors)
    output = getattr(render, part)
    pull = torch.ones_like(output)
    pull[divmod(int(render.alpha.argmax()), scene.camera.width)] = math.nan
    output.backward(pull)
    spoiled = ~torch.isfinite(tensors[0].grad).all(dim=1)
    clean = scene.tensors(torch.float32)
    other = getattr(scene.render(clean), part)
    other.backward(torch.ones_like(other))
    assert 0 < int(spoiled.sum()) < 100
    assert torch.equal(tensors[0].grad[~spoiled], clean[0].grad[~spoiled])


@pytest.mark.parametrize("length", [1e-3, 1.0, 1e3, 1e5, 1e7])
def test_needles_of_any_length(scene_of: Any, length: float) -> None:
    """Axes of 1 : 1e-9 : 1e-9, seen from the side, from the end and by the clamped Jacobian."""
    scene = scene_of("needles")
    scene.scales[:] = (torch.tensor([length, length * 1e-9, length * 1e-9])).float().double()
    fast, truth = scene.tensors(torch.float32), scene.tensors(torch.float64)
    render, expected = scene.render(fast), scene.render(truth)
    assert render.culled == expected.culled
    error = (render.image.double() - expected.image).abs().detach()
    assert error.median() < 1e-6
    assert error.quantile(0.99) < 1e-4
    render.image.square().sum().backward()
    expected.image.square().sum().backward()
    for name, a, b in zip(NAMES, fast, truth, strict=False):
        assert torch.isfinite(a.grad).all(), name
        assert (a.grad - b.grad).norm() < 1e-3 * b.grad.norm(), name


def test_nothing_is_folded_back_into_the_image(dtype: torch.dtype) -> None:
    """Beyond the radius where distortion stops growing, the polynomial would put Gaussians in the image."""
    camera = SplatCamera(np.eye(4), fx=20, fy=20, cx=12, cy=9, width=24, height=18, k1=-0.5)
    outside = np.array([1.2, 0.0])
    assert 0 < camera.distort(outside)[0] * 20 + 12 < 24
    for tangent, visible in ((1.2, 0), (0.3, 1)):
        tensors = [
            torch.tensor([[2 * tangent, 0.0, 2.0]], dtype=dtype),
            torch.tensor([[1.0, 0.0, 0.0, 0.0]], dtype=dtype),
            torch.full((1, 3), 0.05, dtype=dtype),
            torch.full((1,), 0.9, dtype=dtype),
            torch.ones(1, 3, dtype=dtype),
        ]
        render = rasterize(*tensors, camera)
        assert render.visible == visible
        assert render.culled == 0
        assert bool(render.image.any()) == bool(visible)

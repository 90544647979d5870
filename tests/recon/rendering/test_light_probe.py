"""Light from all sides: its energy and its direction, against closed forms."""

import cv2
import numpy as np
import pytest
import torch

from recon.data.world import WorldTransform
from recon.rendering.cameras.camera_paths import level_axes
from recon.rendering.light_probe import LightProbe, light_probe
from recon.scene.environment import Environment, texels
from recon.scene.gaussians import Gaussians
from tests.recon.rendering.scenes import axis_of, scene, sheet, view

AXES = cv2.Rodrigues(np.array([0.4, -1.1, 0.3]))[0]
WORLD = WorldTransform(origin=(100.0, -50.0, 7.0), unit=2.5)
PLACE = np.array([0.2, -0.1, 0.05])
"""In the scene."""


def solid_angles(rows: int) -> np.ndarray:
    """Solid angles of the texels, [rows, 2 * rows]: they fill the sphere."""
    edges = np.sin(np.pi * (0.5 - np.arange(rows + 1) / rows))
    return np.tile((-np.diff(edges) * np.pi / rows)[:, None], (1, 2 * rows))


def sky(light: np.ndarray) -> Environment:
    """An environment of light [rows, 2 * rows, 3]."""
    return Environment(torch.from_numpy(np.log(light)).movedim(2, 0).float().contiguous(), AXES)


def ball(direction: np.ndarray, sigma: float, light: float, opacity: float) -> Gaussians:
    """One round Gaussian, 2 away from PLACE."""
    whole = sheet(2 * direction + PLACE, (1, 0, 0), (0, 1, 0), light, 2.0)
    logit = float(np.log(opacity / (1 - opacity)))
    return Gaussians(
        whole.parameters
        | {"log_scales": torch.full((1, 3), np.log(sigma)), "opacity_logits": torch.full((1,), logit)}
    )


NOTHING = Gaussians(sheet((0, 0, 2), (1, 0, 0), (0, 1, 0), 1.0, 0.5).rows(torch.zeros(0, dtype=torch.int64)))


def test_an_even_sky_is_even_and_all_of_its_light_is_there() -> None:
    probe = light_probe(scene(NOTHING, environment=sky(np.full((8, 16, 3), 3.0))), (0, 0, 0), 16)
    np.testing.assert_allclose(probe.light, 3.0, rtol=1e-5)
    assert (probe.light[..., 1] * solid_angles(16)).sum() == pytest.approx(4 * np.pi * 3, rel=1e-5)
    np.testing.assert_array_equal(probe.axes, AXES)
    assert probe.alpha is None
    assert probe.known == 1


def test_a_sky_stands_where_it_stood() -> None:
    """Its own map comes out again, over fourteen stops."""
    x, y, z = np.moveaxis(texels(32), -1, 0)
    light = 2.0 ** (7 * np.stack([x, y, z], -1))
    probe = light_probe(scene(NOTHING, world=WORLD, environment=sky(light)), WORLD.origin, 32)
    np.testing.assert_allclose(np.log2(probe.light), np.log2(light), atol=0.2)


DIRECTIONS = [(0, 0, 1), (0, 0, -1), (1, 0, 1), (-1, -1, 1), (0, 1, 0), (0.2, -1, 0.1)]
"""Along the axes of a map: in the middle of a picture, at a seam, in a corner, at and beside a pole."""


def check_light(probe: LightProbe, direction: np.ndarray, energy: float) -> None:
    """Light by solid angle, and the mean of its directions."""
    rows = len(probe.light)
    arriving = probe.light[..., 1] * solid_angles(rows)
    assert arriving.sum() == pytest.approx(energy, rel=0.02)
    mean = np.einsum("hw,hwc->c", arriving, texels(rows)) @ probe.axes
    assert np.degrees(np.arccos(axis_of(mean) @ direction)) < 0.5


@pytest.mark.parametrize("towards", DIRECTIONS)
def test_a_disc_in_the_sky_has_the_light_of_its_solid_angle(towards: tuple[float, ...]) -> None:
    inside = texels(256) @ axis_of(towards) > np.cos(0.25)
    light = np.where(inside[..., None], 40.0, 1e-6) * np.ones(3)
    energy = (light[..., 0] * solid_angles(256)).sum()
    assert energy == pytest.approx(40 * 2 * np.pi * (1 - np.cos(0.25)), rel=0.05)  # its rim is of texels
    probe = light_probe(scene(NOTHING, environment=sky(light)), (0, 0, 0), 64)
    check_light(probe, axis_of(towards) @ AXES, energy)


@pytest.mark.parametrize("towards", DIRECTIONS)
def test_a_gaussian_has_the_light_of_its_solid_angle(towards: tuple[float, ...]) -> None:
    direction = axis_of(towards) @ AXES
    given = scene(ball(direction, 0.1, 40.0, 0.8), world=WORLD, environment=sky(np.full((8, 16, 3), 1e-6)))
    limits = given.renderer.limits
    floor = limits.tau * 1.0 / 40.0  # below which it is not drawn
    variance = 0.05**2  # seen from 2 away; to that comes what blurs a pixel, of which there are 128 to pi
    energy = 40 * 2 * np.pi * (variance + limits.blur * (np.pi / 128) ** 2) * (0.8 - floor)
    check_light(light_probe(given, WORLD.to_world(PLACE), 64), direction, energy)


def test_without_a_sky_the_middle_is_where_the_views_look_and_the_left_is_left() -> None:
    given = scene(ball(axis_of([-1, 0, 1]), 0.2, 8.0, 0.9), (view(),))  # y is down, and so is ahead z
    axes = level_axes(given.views)
    np.testing.assert_allclose(axes, [[-1, 0, 0], [0, -1, 0], [0, 0, 1]], atol=1e-12)
    probe = light_probe(given, PLACE, 32)
    row, column = np.unravel_index(probe.light[..., 0].argmax(), (32, 64))
    # 45 degrees to the left of the middle, which is column 32, at the height of the horizon.
    assert abs(row + 0.5 - 16) <= 3
    assert abs(column + 0.5 - 24) <= 3


def test_the_light_of_a_cut_out_object_has_alpha() -> None:
    given = scene(ball(np.array([0.0, 0, 1]), 0.4, 8.0, 0.99))
    given.record.__dict__["transparent"] = True
    probe = light_probe(given, PLACE, 32)
    assert probe.alpha is not None
    assert probe.light.shape == (32, 64, 3)
    assert probe.alpha.max() > 0.8
    np.testing.assert_allclose(probe.light[..., 1], 8 * probe.alpha, atol=0.02)
    assert probe.known == pytest.approx((probe.alpha * solid_angles(32)).sum() / (4 * np.pi), rel=1e-3)

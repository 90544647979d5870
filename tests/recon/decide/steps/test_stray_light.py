"""Glare from dark points before a lamp: its share, and 0 without any."""

import numpy as np
import pytest
import torch

from drivers.sim.camera import optics
from recon.data.geometry import project
from recon.decide.steps.stray_light import FEWEST_POINTS, glare_of
from recon.observe import glare

DIM, LAMP = 0.01, 60.0


def before_a_lamp(dataset, share, scatter=optics.scattered, noise=0.02):
    """A dim world with one lamp in it, as the views would see it through such lenses."""
    place = dataset.points().xyz.mean(axis=0)
    rng, images = np.random.default_rng(5), []
    for view in dataset.train:
        height, width = view.lens.height, view.lens.width
        (x, y), _ = (part[0] for part in project(view.lens, place[None]))
        rows, columns = np.mgrid[:height, :width] + 0.5
        light = np.where((columns - x) ** 2 + (rows - y) ** 2 < 9, LAMP, DIM)[..., None].repeat(3, axis=2)
        scattered = scatter(light, share) * np.exp(noise * rng.standard_normal((height, width, 1)))
        images.append((scattered.astype(np.float32), np.ones((height, width), bool)))
    return images


def as_modelled(light, share):
    return glare.scattered(torch.from_numpy(light), share).numpy()


@pytest.mark.parametrize("share", [0.004, 0.02])
def test_the_share_is_told(toy_long, share):
    shares, rung = glare_of(toy_long, before_a_lamp(toy_long, share, as_modelled))
    assert rung.taken, rung.reason
    assert len(shares) == len({view.camera for view in toy_long.train})
    np.testing.assert_allclose(shares, share, rtol=0.1)


@pytest.mark.parametrize("share", [0.004, 0.02])
def test_the_dark_is_nearer_to_its_light_though_the_halo_has_another_shape(toy_long, share):
    images = before_a_lamp(toy_long, share)
    shares, rung = glare_of(toy_long, images)
    assert rung.taken, rung.reason
    veiled = torch.from_numpy(np.stack([light for light, _ in images])).double()
    freed = torch.stack([(one - shares[0] * glare.spread(one)) / (1 - shares[0]) for one in veiled])
    dark = veiled < 1
    before, after = (float(torch.log2(light[dark] / DIM).abs().median()) for light in (veiled, freed))
    assert after < 0.7 * before, (before, after, shares)


def test_none_is_found_where_there_is_none(toy_long):
    shares, rung = glare_of(toy_long, before_a_lamp(toy_long, 0.0))
    assert not rung.taken
    assert max(shares) < 0.001


def test_clipped_lamps_tell_nothing(toy_long):
    images = [(light, light.max(-1) < 1) for light, _ in before_a_lamp(toy_long, 0.02)]
    shares, rung = glare_of(toy_long, images)
    assert not rung.taken
    assert not any(shares)
    assert f"fewer than {FEWEST_POINTS} dark scene points" in rung.reason

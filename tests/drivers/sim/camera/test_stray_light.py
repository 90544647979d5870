"""Light that a simulated lens scatters: none is lost, none where there is none."""

import numpy as np
import pytest

from drivers.sim import rigs
from drivers.sim.camera.optics import scattered


def test_light_is_moved_and_not_made():
    light = np.random.default_rng(0).uniform(0, 1, (48, 64, 3)) ** 8
    blurred = scattered(light, 0.1)
    assert blurred.mean() == pytest.approx(light.mean(), rel=0.05)
    np.testing.assert_allclose(scattered(np.ones((48, 64, 3)), 0.1), 1)
    np.testing.assert_allclose(scattered(light, 0.0), light, atol=1e-12)


def test_a_lamp_lightens_the_dark_all_over_the_picture():
    light = np.zeros((48, 64, 1))
    light[24, 32] = 1.0
    blurred = scattered(light, 0.02)[..., 0]
    assert blurred[24, 32] == pytest.approx(0.98, abs=0.005)
    assert blurred[24, 36] > blurred[24, 44] > blurred[24, 62] > 1e-7


def test_a_rig_has_it_if_asked_for():
    plain, veiled = (rigs.simulate("toy", glare=share) for share in (0.0, 0.05))
    light = np.zeros((48, 64, 3))
    light[10, 10] = 1.0
    dark, lit = (rig.bodies[0].optics.exposure(light)[30, 40] for rig in (plain, veiled))
    assert (dark == 0).all()
    assert (lit > 0).all()

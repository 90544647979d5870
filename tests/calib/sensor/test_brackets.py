"""A sensor from two exposures of a scene, against the simulated truth."""

from dataclasses import replace

import numpy as np
import pytest

from calib.sensor import brackets
from calib.sensor.brackets import Blind
from calib.sensor.linearity import straightness
from drivers.sim.camera.sensor import SensorModel, SimulatedSensor

from .conftest import MODEL

BLACK, WHITE = np.full(4, 256.0), 4095.0


def shots(model: SensorModel, seed: int, moved: int = 0, grain: float = 0.0) -> list[np.ndarray]:
    """Three exposures of something to look at, 3 EV apart and jittering; the last one may see it shifted.

    grain: standard deviation of texture as fine as photosites, stops.
    """
    sensor, rng = SimulatedSensor(model, 240, 240, seed, "bracket"), np.random.default_rng((seed, 3))
    y, x = np.mgrid[0:240, 0:240] / 120 - 1
    waves = sum(
        rng.normal() * np.sin(rng.uniform(1, 25) * x + rng.uniform(1, 25) * y + rng.uniform(0, 7))
        for _ in range(12)
    )
    light = np.exp2(waves * 1.2 + 3 * x - 4) * np.tile(((0.55, 1), (1, 0.7)), (120, 120))
    light *= np.exp2(grain * rng.standard_normal(light.shape))
    taken = []
    for amount in (1 / 16, 1 / 2, 4.0):
        shifted = np.roll(light, moved, axis=1) if amount == 4.0 else light
        scene = shifted * model.white_electrons * amount * np.exp(0.01 * rng.standard_normal())
        taken.append(sensor.expose(scene, 0.25 * amount, 1.0, rng))
    return taken


def blind(model: SensorModel, seeds: range, moved: int = 0, grain: float = 0.0) -> Blind:
    pairs = []
    for seed in seeds:
        short, middle, long = shots(model, seed, moved, grain)
        for a, b in ((middle, short), (long, middle)):
            pair = brackets.compare(a, b, BLACK, WHITE)
            assert pair is not None
            pairs.append(pair)
    return brackets.pooled(pairs, WHITE - 256.0)


@pytest.fixture(scope="module")
def plain() -> Blind:
    return blind(MODEL, range(3))


def test_gain_and_read_noise_lie_within_their_errors(plain: Blind) -> None:
    assert plain.transfer is not None
    gain, error = brackets.gain(plain.transfer)
    assert gain == pytest.approx(0.4, rel=0.015)
    assert abs(gain - 0.4) < 3 * error
    noise = brackets.read_noise(plain.transfer)
    assert noise is not None
    # It holds the fixed pattern of the dark, half an electron.
    assert noise[0] == pytest.approx(3.04, rel=0.04)
    assert abs(noise[0] - 3.0) < 3 * noise[1]


def test_black_and_ceiling(plain: Blind) -> None:
    np.testing.assert_allclose(BLACK + plain.black, np.ravel(MODEL.black), atol=0.1)
    assert np.all(np.abs(BLACK + plain.black - np.ravel(MODEL.black)) < 4 * plain.black_error)
    assert plain.plateau is not None
    assert plain.plateau.level == 4095
    low = blind(replace(MODEL, ceiling=3550), range(2))
    assert low.plateau is not None
    assert low.plateau.level == 3550
    assert low.transfer is not None
    assert low.transfer.gain == pytest.approx(0.4, rel=0.02)


def test_a_straight_response_is_called_straight_and_a_bent_one_bent(plain: Blind) -> None:
    line = straightness(plain.levels, 1e-5)
    assert line is not None
    assert line.linear
    bent = straightness(blind(replace(MODEL, nonlinearity=0.02), range(3)).levels, 1e-5)
    assert bent is not None
    assert not bent.linear
    assert abs(bent.share - 0.02) < 4 * bent.error


def test_fine_texture_bends_no_response() -> None:
    """Mix full photosites with others that are not."""
    line = straightness(blind(MODEL, range(3), grain=0.7).levels, 1e-5)
    assert line is not None
    assert line.linear
    assert abs(line.share) < 3 * line.error


def test_a_scene_that_moves_tells_no_gain() -> None:
    moved = blind(MODEL, range(2), moved=2)
    assert moved.transfer is None or abs(moved.transfer.gain - 0.4) < 3 * brackets.gain(moved.transfer)[1]


def test_two_equal_exposures_and_darkness_tell_nothing() -> None:
    sensor, rng = SimulatedSensor(MODEL, 120, 120, 0, "dark"), np.random.default_rng(0)
    dark = sensor.expose(np.zeros((120, 120)), 0.1, 1.0, rng)
    assert brackets.compare(dark, dark, BLACK, WHITE) is None
    full = np.full((120, 120), 4095, np.uint16)
    assert brackets.compare(full, dark, BLACK, WHITE) is None

"""Darks and flats of simulated sensors, as the tests of their measurement want them."""

from collections.abc import Callable

import numpy as np
import pytest

from calib.sensor.emva1288.emva import Frames, Nominal
from calib.sensor.stack import Stack, gather
from drivers.sim.camera.sensor import SensorModel, SimulatedSensor

SIDE = 160
MODEL = SensorModel(
    gain=0.4, read_noise=3.0, full_well=10_300.0, black=((256.0, 257.3), (255.0, 256.5)), bit_depth=12,
    prnu=0.008, dsnu=0.5, dark_current=0.5, hot_share=1e-3, hot_current=100.0, dead_share=5e-4,
)  # fmt: skip
Shoot = Callable[..., tuple[SimulatedSensor, Frames]]


def dark_stack(sensor: SimulatedSensor, seconds: float, count: int, key: int) -> Stack:
    """Repeated darks."""
    rng, shape = np.random.default_rng((5, key)), sensor.response.shape
    return gather((sensor.expose(np.zeros(shape), seconds, 1.0, rng) for _ in range(count)), seconds)


def even_light(shape: tuple[int, int]) -> np.ndarray:
    """A flat that falls off by 30 % to the corners, behind colour filters."""
    y, x = (np.mgrid[0 : shape[0], 0 : shape[1]] + 0.5) / np.array(shape).reshape(2, 1, 1) * 2 - 1
    sites = np.tile(((0.55, 1.0), (1.0, 0.7)), (shape[0] // 2, shape[1] // 2))
    return np.asarray((1 - 0.15 * (x**2 + y**2)) * sites)


@pytest.fixture(scope="session")
def shoot() -> Shoot:
    """Darks at two times and flats at eight exposures that flicker, of one sensor."""

    def frames(
        model: SensorModel = MODEL, seed: int = 0, darks: bool = True
    ) -> tuple[SimulatedSensor, Frames]:
        sensor, rng = SimulatedSensor(model, SIDE, SIDE, seed, "test"), np.random.default_rng((seed, 7))
        few, stacks = [], []
        for seconds in (0.01, 4.0) if darks else ():
            shots = [sensor.expose(np.zeros((SIDE, SIDE)), seconds, 1.0, rng) for _ in range(12)]
            few.append(shots[:8])
            stacks.append(gather(shots, seconds))
        flats = []
        for step in range(8):
            amount = even_light((SIDE, SIDE)) * 1.6 * model.white_electrons * 2.0 ** (step - 7)
            flicker = 1 + 0.003 * rng.standard_normal(4)
            flats.append(gather((sensor.expose(amount * f, 0.01, 1.0, rng) for f in flicker), 2.0**step, 256))
        return sensor, Frames(stacks, flats, few)

    return frames


@pytest.fixture(scope="session")
def nominal() -> Nominal:
    """Levels in the files of such a sensor."""
    return Nominal(np.full(4, 256.0), 4095.0)

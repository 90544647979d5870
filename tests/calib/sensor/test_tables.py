"""Darks and flats of a sensor whose table is larger than 2x2: each of its sites on its own."""

import numpy as np

from calib.sensor.emva1288 import emva
from calib.sensor.emva1288.emva import Frames, Nominal
from calib.sensor.stack import gather
from drivers.sim.camera.sensor import SensorModel, SimulatedSensor
from imaging.sensor.cfa import Cfa, as_tile, mosaic

WIDTH, HEIGHT = 192, 144


def test_a_sensor_of_x_trans_is_told_as_it_is() -> None:
    cfa, rng = Cfa.X_TRANS, np.random.default_rng(2)
    black = as_tile(256 + np.random.default_rng(1).normal(0, 0.8, cfa.tile))
    model = SensorModel(
        gain=0.4, read_noise=3.0, full_well=10_300.0, black=black, bit_depth=12, prnu=0.008, dsnu=0.5
    )
    sensor = SimulatedSensor(model, WIDTH, HEIGHT, 3, "x", 0)
    none = np.zeros((HEIGHT, WIDTH))
    colour = mosaic(np.broadcast_to([0.5, 1.0, 0.7], (HEIGHT, WIDTH, 3)), cfa)
    darks = gather((sensor.expose(none, 0.01, 1.0, rng) for _ in range(16)), 0.01, None, cfa.tile)
    flats = [
        gather((sensor.expose(colour * light, 0.01, 1.0, rng) for _ in range(8)), light, 256.0, cfa.tile)
        for light in (1600.0, 6400.0, 12800.0)
    ]
    nominal = Nominal(np.full(36, 256.0), 4095.0, cfa.tile)
    measured, _ = emva.measure_emva(Frames([darks], flats), nominal, 100.0)
    for value, true in (
        (measured.gain, 0.4),
        (measured.read_noise, 3.0),
        (measured.prnu, 0.008),
        (measured.dsnu, 0.5),
    ):
        assert value is not None
        assert abs(value.value - true) < min(4 * value.sigma, 0.06 * true)
    assert measured.black is not None
    levels = np.array([[level.value for level in row] for row in measured.black])
    errors = np.array([[level.sigma for level in row] for row in measured.black])
    assert np.abs(levels - np.array(black)).max() < 0.1
    assert np.mean(np.abs(levels - np.array(black)) < 2 * errors) > 0.85
    assert measured.ceiling is not None
    assert measured.ceiling.value == 4095

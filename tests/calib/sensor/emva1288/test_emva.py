"""A sensor from darks and flats against the simulated truth: values, and intervals that hold them."""

from dataclasses import replace
from itertools import chain

import numpy as np
import pytest

from calib.sensor.emva1288 import emva
from calib.sensor.emva1288.emva import Frames, Nominal
from imaging.sensor.sensor_calibration import Measured, SensorCalibration
from tests.calib.sensor.conftest import MODEL, Shoot, dark_stack

TRUE = {"gain": 0.4, "read_noise": 3.0, "prnu": 0.008, "dsnu": 0.5, "dark_current": 0.5}


def determined(calibration: SensorCalibration, name: str) -> Measured:
    value = getattr(calibration, name)
    assert isinstance(value, Measured), f"{name} is not determined"
    return value


def test_every_value_is_close_and_as_close_as_it_says(shoot: Shoot, nominal: Nominal) -> None:
    for seed in range(2):
        _, frames = shoot(seed=seed)
        measured, _ = emva.measure_emva(frames, nominal, 100.0)
        assert measured.iso == 100.0
        for name, allowed in (("gain", 0.01), ("read_noise", 0.02), ("prnu", 0.1), ("dark_current", 0.02)):
            value = determined(measured, name)
            assert value.value == pytest.approx(TRUE[name], rel=allowed), name
            assert 0 < value.sigma < allowed * TRUE[name], name
            assert abs(value.value - TRUE[name]) < 4 * value.sigma, name
        assert abs(determined(measured, "dsnu").value - 0.5) < 4 * determined(measured, "dsnu").sigma
        assert measured.black is not None
        for level, true in zip(chain(*measured.black), chain(*MODEL.black), strict=True):
            assert abs(level.value - true) < min(0.1, 4 * level.sigma)
        assert determined(measured, "ceiling").value == 4095
        assert determined(measured, "full_well").value == pytest.approx((4095 - 256.2) / 0.4, rel=0.01)
        assert measured.linear
        assert measured.row_noise is None
        light, variance = np.array(measured.transfer).T
        # (K read)^2 + rounding without light, K DN^2 for each DN of it.
        np.testing.assert_allclose(variance, 0.4 * light + 1.44 + 1 / 12, rtol=0.2)


def test_white_may_end_before_the_nominal_one(shoot: Shoot, nominal: Nominal) -> None:
    for model, end in (
        (replace(MODEL, ceiling=3600), 3600.0),
        (replace(MODEL, full_well=8000.0), 255.0 + 0.4 * 8000.0),
    ):
        _, frames = shoot(model)
        measured, _ = emva.measure_emva(frames, nominal, 100.0)
        ceiling = determined(measured, "ceiling")
        assert ceiling.value == pytest.approx(end, abs=1.0)
        white = measured.levels().white
        assert white is not None
        # A converter ends sharply; a full well is read with noise, and what scatters below counts as full.
        assert white == end if model.ceiling else end - 12 < white < end
        assert determined(measured, "gain").value == pytest.approx(0.4, rel=0.01)


def test_rows_that_shake_are_told_apart_from_photosites(shoot: Shoot, nominal: Nominal) -> None:
    _, frames = shoot(replace(MODEL, row_noise=1.0))
    measured, _ = emva.measure_emva(frames, nominal, 100.0)
    assert determined(measured, "row_noise").value == pytest.approx(1.0, rel=0.08)
    assert determined(measured, "read_noise").value == pytest.approx(3.0, rel=0.02)
    noise = measured.noise()
    assert noise is not None
    assert noise.read_noise == pytest.approx(np.sqrt(10.0), rel=0.02)


def test_a_sensor_that_counts_coarsely(shoot: Shoot, nominal: Nominal) -> None:
    """A scatter of 0.2 DN: mean and variance of the numbers of darks are those of rounding."""
    model = replace(MODEL, gain=0.1, read_noise=2.0, full_well=38_000.0)
    _, frames = shoot(model)
    measured, _ = emva.measure_emva(frames, nominal, 100.0)
    assert determined(measured, "read_noise").value == pytest.approx(2.0, rel=0.02)
    assert determined(measured, "gain").value == pytest.approx(0.1, rel=0.015)
    assert measured.black is not None
    for level, true in zip(chain(*measured.black), chain(*model.black), strict=True):
        assert level.value == pytest.approx(true, abs=0.05)
    blind, _ = emva.measure_emva(Frames(frames.darks, frames.flats), nominal, 100.0)
    assert blind.black is not None
    naive = max(abs(a.value - b) for a, b in zip(chain(*blind.black), chain(*model.black), strict=True))
    assert naive > 0.05, "what plain means say"


def test_a_black_level_that_noise_reaches_below(shoot: Shoot) -> None:
    model = replace(MODEL, black=((1.5, 1.5), (1.2, 1.8)))
    _, frames = shoot(model)
    measured, _ = emva.measure_emva(frames, Nominal(np.full(4, 2.0), 4095.0), 100.0)
    assert measured.black is not None
    for level, true in zip(chain(*measured.black), chain(*model.black), strict=True):
        assert level.value == pytest.approx(true, abs=0.05)
    assert determined(measured, "read_noise").value == pytest.approx(3.0, rel=0.02)


def test_all_defects_and_no_others(shoot: Shoot, nominal: Nominal) -> None:
    sensor, frames = shoot(replace(MODEL, hot_current=400.0), seed=3)
    measured, _ = emva.measure_emva(frames, nominal, 100.0)
    assert measured.defects is not None
    at = {(one.x, one.y): one.kind for one in measured.defects}
    # 4 s of darks: a hundred electrons are far beyond 10 standard deviations.
    for y, x in zip(*np.nonzero(sensor.dark_current > 25.0), strict=True):
        assert at.pop((int(x), int(y))) == "hot"
    for y, x in zip(*np.nonzero(sensor.dead), strict=True):
        assert at.pop((int(x), int(y)), "dead") in ("dead", "hot")
    rest = {place for place in at if not sensor.hot[place[1], place[0]]}
    assert not rest
    mask = measured.levels().valid(160, 160)
    assert (~mask).sum() == len(measured.defects)


def test_a_bent_response_is_recognised_and_straightened(shoot: Shoot, nominal: Nominal) -> None:
    _, frames = shoot(replace(MODEL, nonlinearity=0.02))
    measured, _ = emva.measure_emva(frames, nominal, 100.0)
    assert measured.linear is False
    bend = determined(measured, "nonlinearity")
    assert abs(bend.value - 0.02) < 4 * bend.sigma < 0.01
    assert determined(measured, "gain").value == pytest.approx(0.4, rel=0.01)


def test_the_fall_of_light(shoot: Shoot, nominal: Nominal) -> None:
    _, frames = shoot()
    _, fall = emva.measure_emva(frames, nominal, 100.0)
    assert fall is not None
    radius = np.linspace(0.1, 1.0, 10) ** 2
    a, b, c = fall.vignetting
    np.testing.assert_allclose(1 + radius * (a + radius * (b + radius * c)), 1 - 0.3 * radius, atol=0.004)
    assert abs(a + b + c + 0.3) < 4 * fall.corner_error < 0.02


def test_darks_alone_tell_black_and_defects_and_with_a_gain_the_read_noise(
    shoot: Shoot, nominal: Nominal
) -> None:
    _, frames = shoot()
    alone = Frames(frames.darks)
    measured, fall = emva.measure_emva(alone, nominal, None)
    assert fall is None
    assert measured.black is not None
    assert measured.defects
    assert (measured.prnu, measured.ceiling, measured.linear) == (None, None, None)
    rough = determined(measured, "gain")
    assert abs(rough.value - 0.4) < 4 * rough.sigma, "the dark current has photon noise too"
    assert rough.source == "darks"
    gain = Measured(value=0.4, sigma=0.004, source="brackets")
    known, _ = emva.measure_emva(alone, nominal, None, gain)
    read = determined(known, "read_noise")
    assert read.value == pytest.approx(3.0, rel=0.02)
    assert read.sigma == pytest.approx(0.03, rel=0.2), "the gain's error is the read noise's"


def test_flats_alone_tell_the_gain(shoot: Shoot, nominal: Nominal) -> None:
    _, frames = shoot(darks=False)
    measured, _ = emva.measure_emva(frames, nominal, 100.0)
    assert determined(measured, "gain").value == pytest.approx(0.4, rel=0.01)
    assert measured.black is None
    assert measured.dark_current is None


def test_intervals_hold_the_truth_as_often_as_they_say(nominal: Nominal) -> None:
    """Count darks over many sensors: 95 % intervals of black, gain given, of read noise and of dark
    current.
    """
    inside = []
    gain = Measured(value=0.4, sigma=1e-9, source="flats")
    from drivers.sim.camera.sensor import SimulatedSensor

    for seed in range(60):
        sensor = SimulatedSensor(replace(MODEL, dsnu=0.2), 64, 64, seed, "interval")
        stacks = [dark_stack(sensor, seconds, 6, 10 * seed + i) for i, seconds in enumerate((0.01, 8.0))]
        measured, _ = emva.measure_emva(Frames(stacks), nominal, 100.0, gain)
        assert measured.black is not None
        for value, true in (
            (measured.black[0][0], MODEL.black[0][0]),
            (determined(measured, "read_noise"), 3.0),
            (determined(measured, "dark_current"), 0.5),
        ):
            inside.append(abs(value.value - true) <= 1.96 * value.sigma)
    assert 0.90 <= np.mean(inside) <= 0.99

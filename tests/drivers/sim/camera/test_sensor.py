"""The simulated sensor against the EMVA 1288 model: by photon transfer and in closed form."""

from dataclasses import replace

import numpy as np
import pytest

from drivers.sim.camera.sensor import SensorModel, SimulatedSensor

PLAIN = SensorModel(
    gain=0.40, read_noise=3.0, full_well=10_300.0, black=((256.0, 257.0), (255.0, 256.0)), bit_depth=12
)
SIZE = 400


def rng(*key: int) -> np.random.Generator:
    return np.random.default_rng(key)


def flat(
    sensor: SimulatedSensor, electrons: float, key: int, time: float = 0.0, iso_gain: float = 1.0
) -> np.ndarray:
    level = np.full((SIZE, SIZE), electrons)
    return sensor.expose(level, time, iso_gain, rng(7, key)).astype(float)


def black_map(model: SensorModel) -> np.ndarray:
    return np.tile(np.array(model.black), (SIZE // 2, SIZE // 2))


@pytest.mark.parametrize("bits", [12, 14])
@pytest.mark.parametrize("iso_gain", [1.0, 4.0])
def test_photon_transfer_gives_back_gain_and_read_noise(bits: int, iso_gain: float) -> None:
    model = replace(
        PLAIN, bit_depth=bits, gain=0.40 * 4.0 ** (bits == 14), prnu=0.01, dsnu=1.0, black=((1024.0,),)
    )
    sensor = SimulatedSensor(model, SIZE, SIZE, 0, "ptc")
    means, variances = [], []
    # Up to 60 % of the range: clipping would take the tails away.
    for step, electrons in enumerate(np.linspace(0, 0.6 * (model.white - 1024) / model.gain / iso_gain, 12)):
        a = flat(sensor, electrons, 2 * step, iso_gain=iso_gain)
        b = flat(sensor, electrons, 2 * step + 1, iso_gain=iso_gain)
        means.append((a + b).mean() / 2 - 1024)
        variances.append((a - b).var() / 2)
    weights = 1 / np.array(variances)
    gain, floor = np.polyfit(means, variances, 1, w=weights)
    assert gain == pytest.approx(model.gain * iso_gain, rel=0.01)
    read_noise = np.sqrt(floor - 1 / 12) / gain
    assert read_noise == pytest.approx(model.read_noise, rel=0.02)


@pytest.mark.parametrize("electrons", [0.0, 3.0, 40.0, 2000.0])
def test_mean_and_variance_are_those_of_the_model(electrons: float) -> None:
    frame = flat(SimulatedSensor(PLAIN, SIZE, SIZE), electrons, 3) - black_map(PLAIN)
    variance = (PLAIN.gain * PLAIN.read_noise) ** 2 + 1 / 12 + PLAIN.gain**2 * electrons
    assert frame.mean() == pytest.approx(PLAIN.gain * electrons, abs=4 * np.sqrt(variance) / SIZE)
    assert frame.var() == pytest.approx(variance, rel=4 * np.sqrt(2) / SIZE + 0.01)


def test_dark_signal_grows_with_time() -> None:
    model = replace(PLAIN, dark_current=30.0)
    sensor = SimulatedSensor(model, SIZE, SIZE)
    times = np.array([0.0, 2.0, 4.0, 8.0])
    means = [flat(sensor, 0.0, i, time=t).mean() - 256.0 for i, t in enumerate(times)]
    slope, offset = np.polyfit(times, means, 1)
    assert slope == pytest.approx(model.gain * 30.0, rel=0.005)
    assert offset == pytest.approx(0.0, abs=0.03)


def test_dark_electrons_are_poisson() -> None:
    model = replace(PLAIN, dark_current=30.0, read_noise=0.0, gain=4.0)
    frame = flat(SimulatedSensor(model, SIZE, SIZE), 0.0, 1, time=4.0) - black_map(model)
    assert frame.var() == pytest.approx(16.0 * 120.0 + 1 / 12, rel=0.02)


def test_full_well_holds_before_the_gain() -> None:
    model = replace(PLAIN, full_well=5000.0)
    frame = flat(SimulatedSensor(model, SIZE, SIZE), 50_000.0, 0) - black_map(model)
    assert frame.mean() == pytest.approx(0.40 * 5000.0, abs=0.02)
    # No photon noise is left at the full well, read noise is.
    assert frame.std() == pytest.approx(np.sqrt((0.4 * 3.0) ** 2 + 1 / 12), rel=0.02)


def test_well_is_just_above_white_at_iso_100() -> None:
    sensor = SimulatedSensor(PLAIN, SIZE, SIZE)
    assert PLAIN.white_electrons == pytest.approx(3839.0 / 0.40)
    assert 1.0 < PLAIN.full_well / PLAIN.white_electrons < 1.2
    assert np.all(flat(sensor, 1e12, 0) == 4095)
    assert np.all(flat(sensor, PLAIN.white_electrons * 0.9, 0) < 4095)


def test_frames_clip_at_zero_and_white() -> None:
    low = flat(SimulatedSensor(replace(PLAIN, black=((1.0,),), read_noise=30.0), SIZE, SIZE), 0.0, 0)
    assert low.min() == 0.0
    assert 0.3 < (low == 0).mean() < 0.6


def test_prnu_and_dsnu_are_fixed_and_of_the_stated_size() -> None:
    model = replace(PLAIN, prnu=0.01, dsnu=5.0)
    sensor = SimulatedSensor(model, SIZE, SIZE, 1, "pattern")
    dark = np.mean([flat(sensor, 0.0, key) for key in range(32)], axis=0) - black_map(model)
    lit = np.mean([flat(sensor, 8000.0, 100 + key) for key in range(32)], axis=0) - black_map(model)
    dark_noise = (0.4 * 3.0) ** 2 / 32
    assert np.sqrt(dark.var() - dark_noise) / 0.4 == pytest.approx(5.0, rel=0.02)
    # The mean of 32 frames still holds photon noise, 0.16 * 8000 / 32.
    spread = np.sqrt((lit - dark).var() - 0.16 * 8000 / 32 - 2 * dark_noise)
    assert spread / (0.4 * 8000) == pytest.approx(0.01, rel=0.03)
    again = SimulatedSensor(model, SIZE, SIZE, 1, "pattern")
    assert np.array_equal(again.response, sensor.response)
    assert not np.array_equal(SimulatedSensor(model, SIZE, SIZE, 1, "other").response, sensor.response)
    assert not np.array_equal(SimulatedSensor(model, SIZE, SIZE, 2, "pattern").response, sensor.response)


def test_hot_photosites_glow_with_time_and_are_as_many_as_stated() -> None:
    model = replace(PLAIN, hot_share=1e-3, hot_current=2000.0)
    sensor = SimulatedSensor(model, SIZE, SIZE, 3, "hot")
    hot = sensor.dark_current > 0
    assert 0.5e-3 < hot.mean() < 1.6e-3
    frame = flat(sensor, 0.0, 0, time=1.0) - black_map(model)
    expected = np.minimum(sensor.dark_current[hot], model.full_well) * model.gain
    assert np.median(frame[hot] / np.minimum(expected, 3839)) == pytest.approx(1.0, abs=0.05)
    assert np.abs(frame[~hot]).max() < 12


def test_row_noise_is_common_to_a_row() -> None:
    model = replace(PLAIN, row_noise=4.0)
    frame = flat(SimulatedSensor(model, SIZE, SIZE), 100.0, 0) - black_map(model)
    rows = frame.mean(axis=1)
    assert rows.std() / 0.4 == pytest.approx(4.0, rel=0.15)
    assert (frame - rows[:, None]).std() / 0.4 == pytest.approx(np.sqrt(9 + 100 + 0.52), rel=0.03)


def test_the_converter_may_end_below_the_nominal_white() -> None:
    sensor = SimulatedSensor(replace(PLAIN, ceiling=3600), SIZE, SIZE)
    assert np.all(flat(sensor, 1e12, 0) == 3600)
    below = 0.8 * PLAIN.white_electrons
    assert np.array_equal(flat(sensor, below, 1), flat(SimulatedSensor(PLAIN, SIZE, SIZE), below, 1))


def test_the_response_bends_by_the_stated_share_at_white() -> None:
    bent = SimulatedSensor(replace(PLAIN, nonlinearity=0.02), SIZE, SIZE)
    straight = SimulatedSensor(PLAIN, SIZE, SIZE)
    for share in (0.25, 0.5, 0.9):
        light = share * PLAIN.white_electrons
        a, b = (flat(one, light, 0) - black_map(PLAIN) for one in (bent, straight))
        assert a.mean() / b.mean() == pytest.approx(1 - 0.02 * share, abs=2e-4)


def test_dead_photosites_see_less_than_half_and_the_others_what_they_did() -> None:
    some, none = (
        SimulatedSensor(replace(PLAIN, dead_share=1e-3), SIZE, SIZE),
        SimulatedSensor(PLAIN, SIZE, SIZE),
    )
    assert 0.5e-3 < some.dead.mean() < 1.6e-3
    a, b = (flat(one, 5000.0, 0) for one in (some, none))
    assert np.all((a - black_map(PLAIN))[some.dead] < 0.55 * 2000)
    assert np.array_equal(some.response[~some.dead], none.response[~some.dead])
    # Poisson draws shift behind a changed mean, so the frames agree in distribution only.
    assert a[~some.dead].mean() == pytest.approx(b.mean(), abs=0.3)


def test_dark_current_spreads_over_the_photosites() -> None:
    sensor = SimulatedSensor(replace(PLAIN, dark_current=100.0, dark_spread=0.3), SIZE, SIZE, 5, "dark")
    assert np.log(sensor.dark_current).std() == pytest.approx(0.3, rel=0.01)
    assert np.median(sensor.dark_current) == pytest.approx(100.0, rel=0.01)

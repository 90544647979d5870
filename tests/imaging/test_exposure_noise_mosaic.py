"""Exposure scale, sensor noise and the arithmetic of a mosaic."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from imaging.optics.exposure import Exposure
from imaging.sensor.cfa import BAYER, Cfa
from imaging.sensor.mosaic import RawMosaic, as_matrix
from imaging.sensor.noise import SensorNoise


def test_the_scale_is_light_times_gain() -> None:
    assert Exposure(time=0.5).scale == 0.5
    assert Exposure(time=0.5, f_number=2.0).scale == 0.125
    assert Exposure(time=0.5, f_number=2.0, iso=400).scale == 0.5
    assert Exposure(time=0.25).stops == -2.0
    assert Exposure(time=1.0, iso=400).iso_gain == 4.0
    assert Exposure(time=1.0).iso_gain == 1.0


@settings(max_examples=100)
@given(st.floats(1e-6, 1e4), st.floats(0.5, 64), st.floats(25, 409600))
def test_a_stop_is_a_stop_by_any_means(time: float, f_number: float, iso: float) -> None:
    stops = Exposure(time=time, f_number=f_number, iso=iso).stops
    assert Exposure(time=2 * time, f_number=f_number, iso=iso).stops - stops == pytest.approx(1)
    assert Exposure(time=time, f_number=2 * f_number, iso=iso).stops - stops == pytest.approx(-2)
    assert Exposure(time=time, f_number=f_number, iso=2 * iso).stops - stops == pytest.approx(1)


@pytest.mark.parametrize(
    "values",
    [
        {"time": 0.0},
        {"time": -1.0},
        {"time": float("nan")},
        {"time": float("inf")},
        {"time": 1.0, "f_number": 0.0},
        {"time": 1.0, "iso": 0.0},
        {"time": 1.0, "gain": 2.0},
        {},
    ],
)
def test_an_exposure_that_cannot_be_is_refused(values: dict[str, float]) -> None:
    with pytest.raises(ValidationError):
        Exposure(**values)


def test_an_exposure_is_a_value() -> None:
    exposure = Exposure(time=1 / 30, f_number=4, iso=100)
    assert exposure.with_time(2.0) == Exposure(time=2.0, f_number=4, iso=100)
    assert exposure == Exposure.model_validate_json(exposure.model_dump_json())
    assert hash(exposure) == hash(Exposure(time=1 / 30, f_number=4, iso=100))
    with pytest.raises(ValidationError):
        exposure.time = 3.0


@pytest.mark.parametrize(
    ("exposure", "text"),
    [
        (Exposure(time=1 / 8000), "1/8000 s"),
        (Exposure(time=0.5), "0.5 s"),
        (Exposure(time=30.0, f_number=2.8, iso=200), "30 s f/2.8 ISO 200"),
        (Exposure(time=1 / 3), "1/3 s"),
    ],
)
def test_an_exposure_as_photographers_say_it(exposure: Exposure, text: str) -> None:
    assert str(exposure) == text


@settings(max_examples=200)
@given(st.floats(0.01, 20), st.floats(0.5, 50), st.floats(0, 2048), st.sampled_from([4095, 16383, 65535]))
def test_the_noise_profile_comes_back(gain: float, read_noise: float, black: float, white: int) -> None:
    noise = SensorNoise(gain=gain, read_noise=read_noise)
    profile = noise.profile(black, white)
    back = SensorNoise.from_profile(profile, black, white)
    assert back.gain == pytest.approx(gain, rel=1e-9)
    # rounding to whole numbers hides a read noise far below it
    assert back.read_noise == pytest.approx(read_noise, rel=1e-6, abs=1e-4 / gain)
    signal = np.linspace(0, 1, 5)
    expected = noise.variance(signal * (white - black)) / (white - black) ** 2
    assert profile[0] * signal + profile[1] == pytest.approx(expected, rel=1e-9)


def test_the_variance_by_emva() -> None:
    noise = SensorNoise(gain=2.0, read_noise=3.0, prnu=0.01)
    assert noise.variance(np.array([0.0, 100.0, -50.0])) == pytest.approx(
        [36 + 1 / 12, 36 + 1 / 12 + 200 + 1, 36 + 1 / 12]
    )


def test_the_variance_is_that_of_counted_electrons() -> None:
    generator = np.random.default_rng(3)
    noise = SensorNoise(gain=0.7, read_noise=4.0)
    electrons = generator.poisson(900, 200_000) + generator.normal(0, 4.0, 200_000)
    numbers = np.round(0.7 * electrons)
    assert numbers.var() == pytest.approx(float(noise.variance(np.array(630.0))), rel=0.02)


@pytest.mark.parametrize("values", [{"gain": 0.0, "read_noise": 1.0}, {"gain": 1.0, "read_noise": -1.0}])
def test_noise_that_cannot_be_is_refused(values: dict[str, float]) -> None:
    with pytest.raises(ValidationError):
        SensorNoise(**values)


def raw(height: int, width: int, cfa: Cfa = Cfa.GRBG) -> RawMosaic:
    pixels = np.random.default_rng(4).integers(0, 4096, (height, width), dtype=np.uint16)
    return RawMosaic(pixels, cfa, ((10.0, 20.0), (30.0, 40.5)), 4000)


def test_the_signal_site_by_site() -> None:
    sample = raw(5, 7)
    for row in range(5):
        for column in range(7):
            black = sample.black[row % 2][column % 2]
            expected = (float(sample.pixels[row, column]) - black) / (4000 - black)
            assert sample.signal()[row, column] == pytest.approx(expected, rel=1e-6, abs=1e-7)
    assert sample.signal().dtype == np.float32
    assert np.array_equal(sample.saturated(), sample.pixels >= 4000)


def test_noise_below_black_stays_negative() -> None:
    dark = RawMosaic(np.zeros((2, 2), np.uint16), Cfa.RGGB, ((100.0,),), 1100)
    assert dark.signal().tolist() == [[pytest.approx(-0.1)] * 2] * 2
    full = RawMosaic(np.full((2, 2), 1100, np.uint16), Cfa.RGGB, ((100.0,),), 1100)
    assert full.signal().tolist() == [[1.0, 1.0], [1.0, 1.0]]
    assert full.saturated().all()


@settings(max_examples=60)
@given(
    st.sampled_from([*BAYER, Cfa.X_TRANS]),
    st.integers(0, 4),
    st.integers(0, 4),
    st.integers(1, 6),
    st.integers(1, 6),
)
def test_a_window_of_the_mosaic_sees_the_same(cfa: Cfa, top: int, left: int, height: int, width: int) -> None:
    whole = raw(10, 10, cfa)
    part = whole.cropped(top, left, height, width)
    window = (slice(top, top + height), slice(left, left + width))
    assert np.array_equal(part.pixels, whole.pixels[window])
    assert np.array_equal(part.signal(), whole.signal()[window])
    assert np.array_equal(part.cfa.channels(height, width), whole.cfa.channels(10, 10)[window])
    assert part.pixels.flags.c_contiguous


def test_a_matrix_as_tuples() -> None:
    assert as_matrix(np.arange(9).reshape(3, 3)) == ((0.0, 1.0, 2.0), (3.0, 4.0, 5.0), (6.0, 7.0, 8.0))
    assert as_matrix(np.arange(3)) == ((0.0, 1.0, 2.0),)
    with pytest.raises(ValueError, match="reshape"):
        as_matrix(np.arange(8))

"""Choice of the exposures of a bracket that show a view."""

from dataclasses import replace

import numpy as np
import pytest

from calib.view_images import _is_lit
from imaging.merge.linear_frame import LinearFrame, SensorSignalNoise

NOISE = SensorSignalNoise(1e-4, 1e-6)


@pytest.fixture
def black() -> LinearFrame:
    """A frame of 400 x 300 that holds read noise alone."""
    signal = np.random.default_rng(0).normal(0, 1e-3, (300, 400)).astype(np.float32)
    none, every = np.zeros(signal.shape, bool), np.ones(signal.shape, bool)
    return LinearFrame(signal, 2.0**-26, saturated=none, dark=none, valid=every, noise=NOISE)


def test_a_black_frame_is_not_lit(black):
    assert not _is_lit(black)


@pytest.mark.parametrize("level", [0.01, 0.5])
def test_a_frame_of_a_few_lamps_is(black, level):
    signal = black.signal.copy()
    signal[100, 200:204] = level
    assert _is_lit(replace(black, signal=signal))


@pytest.mark.parametrize("step", [1, 2])
def test_a_lamp_of_one_colour_counts_as_one_of_all(black, step):
    """Light every second photosite of every second row by a blue lamp."""
    signal = black.signal.copy()
    signal[100:104:step, 200:204:step] = 0.01
    assert _is_lit(replace(black, signal=signal))


@pytest.mark.parametrize("level", [0.01, 1.0])
def test_hot_photosites_are_no_light(black, level):
    """One in ten thousand, as of a warm sensor; the brightest of them are saturated."""
    signal = black.signal.copy()
    signal[20::60, 30::50] = level
    hot = signal >= 1
    assert (signal >= level).mean() > 1e-4
    assert not _is_lit(replace(black, signal=signal, saturated=hot))


def test_so_are_a_saturated_one_and_one_of_unknown_noise(black):
    assert _is_lit(replace(black, saturated=np.ones_like(black.saturated)))
    assert _is_lit(replace(black, noise=None))

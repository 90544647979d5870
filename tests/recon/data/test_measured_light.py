"""Between which lights a shot tells anything: against the noise model itself."""

import numpy as np
import pytest

from imaging.merge.linear_frame import SensorSignalNoise, code_noise
from imaging.session.calibration import Response
from recon.data.shot import HeldPlanes, Shot, measured_light

LINEAR, SRGB = (Response(kind=kind, evidence="a test") for kind in ("linear", "srgb"))
PLANE, MASK = np.zeros((2, 2), np.float32), np.zeros((2, 2), bool)


def shot(**values) -> Shot:
    return Shot("a", 0.5, HeldPlanes(PLANE, MASK, MASK, ~MASK), **values)


def test_of_raw_it_is_where_the_signal_is_three_deviations_and_where_it_saturates() -> None:
    noise = SensorSignalNoise(slope=2e-4, floor=1e-6)
    limits = measured_light(shot(noise=noise, ceiling=0.9), LINEAR)
    assert limits is not None
    signal = np.array([0.5 * limits[0]])
    assert signal == pytest.approx(3 * np.sqrt(noise.variance(signal)))
    assert limits[1] == pytest.approx(1.8)


def test_of_a_photograph_the_response_tells() -> None:
    limits = measured_light(shot(noise=code_noise(SRGB)), SRGB)
    assert limits is not None
    # Codes below 3 in 255 are noise; sRGB is a straight line there.
    assert 0.5 * limits[0] * 12.92 == pytest.approx(4 / 255, rel=0.1)
    assert 0.5 * limits[1] == pytest.approx(((254 / 255 + 0.055) / 1.055) ** 2.4, rel=1e-4)


def test_without_noise_only_white_bounds_it_and_of_exr_nothing() -> None:
    assert measured_light(shot(ceiling=0.9), LINEAR) == (0.0, pytest.approx(1.8))
    assert measured_light(shot(), LINEAR) is None

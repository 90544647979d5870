"""Readings combined into one scale: closed forms, and readings that contradict each other."""

import numpy as np
import pytest

from calib.luminance.scale import Comparison, combined
from imaging.errors import CalibrationError


def reading(known: float, light: float, scatter: float, stated: float, source: str) -> Comparison:
    return Comparison(f"0000/{source}:1,2,30,40", known, light, scatter, stated, source)


def test_one_reading_is_the_scale_and_both_errors_are_its_error() -> None:
    scale = combined([reading(80.0, 0.4, 0.03, 0.04, "spot")])
    assert scale.value == pytest.approx(200.0)
    assert scale.error == pytest.approx(0.05 * 200.0)
    assert scale.residuals == pytest.approx([0.0])


def test_different_lamps_are_averaged_by_their_errors() -> None:
    scale = combined([reading(100.0, 1.0, 0.0, 0.02, "a"), reading(103.0, 1.0, 0.0, 0.04, "b")])
    assert np.log(scale.value / 100.0) == pytest.approx(0.2 * np.log(1.03))
    assert scale.error / scale.value == pytest.approx(0.04 / np.sqrt(5))


def test_the_error_of_one_meter_stays_however_often_it_is_read() -> None:
    scale = combined([reading(100.0 + place % 2, 1.0, 0.02, 0.03, "spot") for place in range(100)])
    assert scale.error / scale.value == pytest.approx(np.hypot(0.03, 0.002))


def test_intervals_hold_as_often_as_they_say() -> None:
    rng, inside = np.random.default_rng(0), 0
    for _ in range(400):
        spot, lamp = np.exp(rng.normal(0.0, (0.03, 0.05)))
        sources = [("spot", spot, 0.03)] * 3 + [("lamp", lamp, 0.05)]
        read = [
            reading(50.0 * off * np.exp(rng.normal(0.0, 0.01)), 0.5, 0.01, error, name)
            for name, off, error in sources
        ]
        scale = combined(read)
        inside += abs(np.log(scale.value / 100.0)) < 1.96 * scale.error / scale.value
    assert 0.92 < inside / 400 < 0.98


def test_references_that_contradict_each_other_are_refused_by_name() -> None:
    lamps = [reading(100.0, 1.0, 0.01, 0.03, "a"), reading(102.0, 1.0, 0.01, 0.03, "b")]
    assert 100.0 < combined(lamps).value < 102.0
    message = r"100 cd/m² by 0000/a\S+ and 130 by 0000/c\S+, 26 % apart .* state a larger error\.$"
    with pytest.raises(CalibrationError, match=message):
        combined([*lamps, reading(130.0, 1.0, 0.01, 0.03, "c")])

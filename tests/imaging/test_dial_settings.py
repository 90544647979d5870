"""What the round numbers of a camera's dials stand for, held against the dials of the simulated camera."""

import pytest

from drivers.sim.camera.shutter import APPLIED_F_NUMBER, APPLIED_TIME
from imaging.dial_settings import meant
from imaging.exposure import Exposure


def times(*labels: float) -> list[float]:
    exact = meant(Exposure(time=label) for label in labels)
    return [exact[Exposure(time=label)].time for label in labels]


def test_round_times_stand_for_powers_of_two() -> None:
    assert times(1 / 60, 1 / 4, 2.0) == [1 / 64, 1 / 4, 2.0]
    assert times(1 / 8000, 30.0) == [2.0**-13, 32.0]
    assert times(*APPLIED_TIME) == pytest.approx(list(APPLIED_TIME.values()))


def test_times_of_another_series_are_meant_as_they_are() -> None:
    assert times(1 / 60, 0.0123) == [1 / 60, 0.0123]
    assert meant([]) == {}


def test_a_bracket_of_apertures_has_the_light_that_its_iris_lets_in() -> None:
    """At f/11 the label is 0.08 stops off: 128 is the square of what the iris takes, not 121."""
    labels = [Exposure(time=1 / 60, f_number=label, iso=100) for label in APPLIED_F_NUMBER]
    exact = meant(labels)
    assert [exact[label].f_number for label in labels] == pytest.approx(list(APPLIED_F_NUMBER.values()))
    bright, dark = exact[labels[0]], exact[labels[-1]]
    assert bright.scale / dark.scale == pytest.approx(32)
    assert bright.iso == 100


def test_apertures_between_the_thirds_and_unknown_ones_stay() -> None:
    odd = [Exposure(time=1 / 60, f_number=value) for value in (1.9, 5.6)]
    assert [meant(odd)[one].f_number for one in odd] == [1.9, 5.6]
    blank = Exposure(time=1 / 60)
    assert meant([blank])[blank] == Exposure(time=1 / 64)

"""Nominal numbers of a camera's dials, against powers of two."""

import math

import pytest

from imaging.optics.dial_settings import SHUTTER_TIMES, meant
from imaging.optics.exposure import Exposure


def times(*labels: float) -> list[float]:
    exact = meant(Exposure(time=label) for label in labels)
    return [exact[Exposure(time=label)].time for label in labels]


def test_round_times_stand_for_powers_of_two() -> None:
    assert times(1 / 60, 1 / 4, 2.0) == [1 / 64, 1 / 4, 2.0]
    assert times(1 / 8000, 30.0) == [2.0**-13, 32.0]
    nearest = [2.0 ** (round(3 * math.log2(label)) / 3) for label in SHUTTER_TIMES]
    assert times(*SHUTTER_TIMES) == pytest.approx(nearest)


@pytest.mark.parametrize(
    ("mark", "thirds"),
    [
        *((1 / 3, -5), (10 / 16, -2), (10 / 13, -1), (0.7692, -1), (3.0, 5), (1 / 10000, -40)),
        *((1 / 12500, -41), (1 / 12800, -41), (1 / 13000, -41), (1 / 16000, -42), (1 / 20000, -43)),
        *((1 / 25000, -44), (1 / 25600, -44), (1 / 32000, -45)),
    ],
)
def test_marks_that_some_dials_have_leave_no_shot_of_the_bracket_rounded(mark: float, thirds: int) -> None:
    """Nikon's 30 s and 1/3 s are 20/3 stops apart, which their marks miss by 11 %."""
    assert times(30.0, 1 / 60, mark) == pytest.approx([32.0, 1 / 64, 2 ** (thirds / 3)])


def test_times_of_another_series_are_meant_as_they_are() -> None:
    assert times(1 / 60, 0.0123) == [1 / 60, 0.0123]
    assert meant([]) == {}


def test_a_bracket_of_apertures_has_the_light_that_its_iris_lets_in() -> None:
    """At f/11 the label is 0.08 stops off: 128 is the square of what the iris takes, not 121."""
    labels = [Exposure(time=1 / 60, f_number=label, iso=100) for label in (2.8, 4.0, 5.6, 8.0, 11.0, 16.0)]
    exact = meant(labels)
    assert [exact[label].f_number for label in labels] == pytest.approx(
        [2.0**stop for stop in (1.5, 2, 2.5, 3, 3.5, 4)]
    )
    bright, dark = exact[labels[0]], exact[labels[-1]]
    assert bright.scale / dark.scale == pytest.approx(32)
    assert bright.iso == 100


def test_apertures_between_the_thirds_and_unknown_ones_stay() -> None:
    odd = [Exposure(time=1 / 60, f_number=value) for value in (1.9, 5.6)]
    assert [meant(odd)[one].f_number for one in odd] == [1.9, 5.6]
    blank = Exposure(time=1 / 60)
    assert meant([blank])[blank] == Exposure(time=1 / 64)

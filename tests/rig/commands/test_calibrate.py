"""`rig calibrate` says how long it takes before it begins, where that is worth a word."""

import re
from pathlib import Path

import pytest

from rig.commands.calibrate import SECONDS, expected

UNITS = {"s": 1.0, "min": 60.0, "h": 3600.0}


def seconds(words: str) -> float:
    """Seconds of a text like `2 min 05 s`."""
    return sum(float(number) * UNITS[unit] for number, unit in re.findall(r"([\d.]+) (h|min|s)", words))


@pytest.mark.parametrize(
    ("views", "megapixels", "cores", "processor", "clock"),
    [(11, 6, 2, 73, None), (200, 12, 2, 2103, 1586)],
    ids=["castle", "walk"],
)
def test_what_was_measured_lies_within_what_is_said(
    views: int, megapixels: int, cores: int, processor: float, clock: float | None
) -> None:
    """bench/results/calibration_size.md and calibration_full_size.md."""
    words = expected([megapixels * 10**6] * views, cores)
    assert words is not None
    assert words.startswith(f"{views} views on {cores} cores: this takes ")
    low, high = map(seconds, re.findall(r"takes (.*) to (.*) in all", words)[0])
    assert low < (clock or processor) < high
    assert SECONDS[0] * views < processor < SECONDS[1] * views


def test_more_cores_take_less_time_and_small_pictures_too() -> None:
    many, few, small = (
        expected([size] * 100, cores) for size, cores in ((2_000_000, 16), (2_000_000, 1), (500_000, 1))
    )
    assert many is not None
    assert few is not None
    assert small is not None
    long = [seconds(words.split(" to ")[1]) for words in (many, few, small)]
    assert long[1] == pytest.approx(1800, abs=1)
    assert long[0] < 0.6 * long[1]
    assert long[2] == pytest.approx(long[1] / 4, abs=1)


def test_what_is_soon_done_is_not_worth_a_word(rig, toy: Path) -> None:
    assert expected([64 * 48] * 6, 2) is None
    _, _, err = rig("calibrate", str(toy), "--only", "response")
    assert "this takes" not in err

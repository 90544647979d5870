"""`rig calibrate` says how long it takes before it begins, where that is worth a word."""

import re
from pathlib import Path

import pytest

from rig.commands.calibrate import WORTH_SAYING, expected, in_words

UNITS = {"s": 1.0, "min": 60.0, "h": 3600.0}


def seconds(words: str) -> float:
    """Seconds of a text like `2 min 05 s`."""
    return sum(float(number) * UNITS[unit] for number, unit in re.findall(r"([\d.]+) (h|min|s)", words))


@pytest.mark.parametrize(
    ("views", "megapixels", "processor", "clock"),
    [
        (108, 0.0768, 124, None),
        (11, 6, 73, None),
        (200, 12, 2103, 1586),
        (50, 2.07, 683, None),
        (18, 12, 134, None),
        (11, 6, 113, None),
        (16, 24, 301, None),
    ],
    ids=["simulated rig", "castle", "walk", "fox", "brighton", "castle again", "banana"],
)
def test_what_was_measured_lies_within_what_is_said(
    views: int, megapixels: float, processor: float, clock: float | None
) -> None:
    """bench/results/calibration_size.md, calibration_full_size.md and real_judges.md."""
    sizes = [int(megapixels * 1e6)] * views
    low, high = expected(sizes, 1)
    assert low < processor < high < 6 * low
    low, high = expected(sizes, 2)
    assert low < (clock or 0.735 * processor) < high
    said = in_words(sizes, 2, 1.0)
    assert said.startswith(f"{views} views on 2 cores: this takes ")
    assert said.endswith(" in all, if nothing else runs here.")
    assert [*map(seconds, re.findall(r"takes (.*) to (.*) in all", said)[0])] == pytest.approx(
        [low, high], rel=0.02
    )


def test_more_cores_take_less_time_and_small_pictures_too() -> None:
    many, few, small = (
        expected([size] * 100, cores)[1] for size, cores in ((2_000_000, 16), (2_000_000, 1), (500_000, 1))
    )
    assert few == pytest.approx(1900)
    assert many < 0.6 * few
    assert few / 4 < small < few / 2


def test_other_work_on_the_machine_is_in_what_is_said() -> None:
    quiet, busy = (in_words([2_000_000] * 50, 2, free) for free in (1.0, 0.25))
    low, high = ([*map(seconds, re.findall(r"takes (.*) to (.*) in all", said)[0])] for said in (quiet, busy))
    assert high == pytest.approx([4 * time for time in low], rel=0.02)
    assert busy.endswith(" in all, if other work leaves 25 % of the cores, as now.")


def test_what_is_soon_done_is_not_worth_a_word(rig, toy: Path) -> None:
    assert expected([64 * 48] * 6, 2)[1] < WORTH_SAYING
    _, _, err = rig("calibrate", str(toy), "--only", "response")
    assert "this takes" not in err

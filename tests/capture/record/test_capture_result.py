"""Report of a capture on missing shots."""

from pathlib import Path

import pytest

from capture.record.capture_result import LISTED, CaptureResult, span
from imaging.errors import PartialError


def said(*missing: str) -> str:
    result = CaptureResult(Path("S"), planned=100, taken=0, earlier=0, missing=missing)
    with pytest.raises(PartialError) as caught:
        result.require_complete()
    return str(caught.value)


def test_each_cause_is_stated_once() -> None:
    assert said(
        "a, frame 0, step 0: unplugged", "a, frame 0, step 1: unplugged", "a, frame 0, step 2: too dark"
    ) == (
        "S: 3 of 100 shots are missing (a, frame 0, step 0 and 1 more: unplugged; a, frame 0, step 2: too "
        "dark): repeat the command with --resume to take them."
    )


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(0.02, "20 ms"), (0.9994, "999 ms"), (0.9996, "1 s"), (3.15, "3.15 s"), (1250.4, "1250 s")],
)
def test_times_have_no_exponents(seconds: float, words: str) -> None:
    assert span(seconds) == words


def test_many_are_told_by_their_causes() -> None:
    lost = [f"b, frame {frame}, step 0: node left does not answer" for frame in range(20)]
    message = said(*lost, "c, frame 3, step 1: too dark")
    assert "21 of 100 shots" in message
    assert (
        "(b, frame 0, step 0 and 19 more: node left does not answer; c, frame 3, step 1: too dark)" in message
    )


def test_many_causes_are_counted() -> None:
    message = said(*(f"a, frame {frame}, step 0: error {frame}" for frame in range(20)))
    assert f"error {LISTED - 1}; and {20 - LISTED} more)" in message
    assert f"error {LISTED}" not in message


def test_nothing_is_said_of_none() -> None:
    CaptureResult(Path("S"), planned=1, taken=1, earlier=0).require_complete()

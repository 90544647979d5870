from datetime import datetime, timedelta
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from capture.imports.originals import Original
from capture.imports.sorting.grouping import PhotoSeries, split_into_brackets
from capture.pictures.read import PictureFacts
from imaging.optics.exposure import Exposure
from imaging.sensor.mosaic import FrameMetadata
from imaging.session.records import CameraRecord

CAMERA = CameraRecord(name="c", serial="1", kind="ldr")
NOON = datetime(2026, 5, 1, 12, 0, 0)


def photo(number: int, stops: float | None, seconds: float) -> Original:
    """stops None: a file that could not be read."""
    path = Path(f"{number}.jpg")
    if stops is None:
        return Original(path, "ldr", None, error="bad")
    metadata = FrameMetadata(captured_at=NOON + timedelta(seconds=seconds))
    picture = PictureFacts("ldr", 8, 6, metadata, (0.0, 0.0, 0.0), 0.0, 1.0)
    return Original(path, "ldr", picture, Exposure(time=2.0**stops / 60, f_number=4))


# Half stops apart at least, in any order.
PATTERNS = st.lists(st.integers(-8, 8), min_size=3, max_size=9, unique=True).map(
    lambda p: [0.5 * n for n in p]
)


@given(
    pattern=PATTERNS,
    brackets=st.integers(2, 6),
    rounding=st.lists(st.floats(-0.07, 0.07), min_size=54, max_size=54),
    unread=st.sets(st.integers(0, 53), max_size=2),
    gap=st.floats(0, 25),
)
@settings(max_examples=200)
def test_a_bracket_that_repeats_is_found_whatever_its_order_and_whatever_cannot_be_read(
    pattern, brackets, rounding, unread, gap
):
    size = len(pattern)
    unread = {number for number in unread if number >= size}  # one bracket at least is whole
    steps = [step + noise for step, noise in zip(pattern * brackets, rounding, strict=False)]
    if min(abs(a - b) for i, a in enumerate(steps[:size]) for b in steps[:i]) < 0.5:
        steps = pattern * brackets
    photos = [photo(n, None if n in unread else s, gap * n) for n, s in enumerate(steps)]
    groups, why = split_into_brackets(PhotoSeries(CAMERA, tuple(photos)), None)
    assert [len(bracket) for bracket in groups] == [size] * brackets
    assert [one for bracket in groups for one in bracket] == photos
    assert f"{brackets} brackets of {size}" in why


@given(stops=st.lists(st.floats(-0.24, 0.24), min_size=1, max_size=40), gap=st.floats(0, 100))
@settings(max_examples=100)
def test_exposures_within_half_a_stop_are_never_a_bracket(stops, gap):
    photos = [photo(n, s, gap * n) for n, s in enumerate(stops)]
    brackets, _ = split_into_brackets(PhotoSeries(CAMERA, tuple(photos)), None)
    assert [len(bracket) for bracket in brackets] == [1] * len(stops)


FALLING = [0.0, -2.0, -4.0, -8.0, -11.0, -13.0]


def grouped(stops, seconds) -> tuple[list[int], str]:
    photos = tuple(photo(n, s, at) for n, (s, at) in enumerate(zip(stops, seconds, strict=True)))
    brackets, why = split_into_brackets(PhotoSeries(CAMERA, photos), None)
    return [len(bracket) for bracket in brackets], why


@pytest.mark.parametrize("start", [0.0, 1000.0])
def test_a_series_set_by_hand_may_lack_an_exposure(start):
    """20 s from shot to shot and 40 s where one is missing, alone and after another series."""
    seconds = [start + at for at in (0, 20, 40, 80, 100, 120)]
    if start:
        lengths, why = grouped([0.0, -2.0, -4.0, *FALLING], [0, 20, 40, *seconds])
        assert lengths == [3, 6]
        assert "repeat" not in why
    else:
        lengths, why = grouped(FALLING, seconds)
        assert lengths == [6]
        assert "repeat" not in why
        assert "pause" not in why


@pytest.mark.parametrize(
    "seconds", [(0, 20, 40, 85, 105, 125), (0, 1, 2, 42, 43, 44), (100, 101, 102, 0, 1, 2)]
)
def test_a_pause_that_cuts_a_series_is_said(seconds):
    """A wait of more than two, another place after camera brackets, and a clock that was set back."""
    lengths, why = grouped(FALLING, seconds)
    assert lengths == [3, 3]
    assert "repeat" not in why
    assert "a bracket ends at a pause of more than 30 s or where the clock goes back" in why
    lengths, why = grouped([0.0, -2.0, -4.0] * 2, range(0, 600, 100))
    assert lengths == [1] * 6
    assert "none is part of a bracket, which ends at a pause of more than 30 s" in why


@given(count=st.integers(1, 30), size=st.integers(1, 12))
def test_a_given_bracket_keeps_every_photo_in_order(count, size):
    photos = [photo(n, 0.0, n) for n in range(count)]
    brackets, _ = split_into_brackets(PhotoSeries(CAMERA, tuple(photos)), size)
    assert [one for bracket in brackets for one in bracket] == photos
    assert all(len(bracket) == size for bracket in brackets[:-1])

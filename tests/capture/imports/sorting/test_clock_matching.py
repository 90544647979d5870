from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from capture.imports.originals import Original
from capture.imports.sorting.clock_matching import clock_offset, match_frames
from capture.pictures.read import PictureFacts
from imaging.optics.exposure import Exposure
from imaging.sensor.mosaic import FrameMetadata
from imaging.session.records import CameraRecord

NOON = datetime(2026, 5, 1, 12, 0, 0)


def brackets(times, whole_seconds=False):
    """One bracket of two photographs at each time, s; None: no file tells it."""
    made = []
    for time in times:
        bracket = []
        for step in range(2):
            when = None if time is None else NOON + timedelta(seconds=time + 0.05 * step)
            if when is not None and whole_seconds:
                when = when.replace(microsecond=0)
            picture = PictureFacts("ldr", 8, 6, FrameMetadata(captured_at=when), (0.0, 0.0, 0.0), 0.0, 1.0)
            bracket.append(Original(Path("x.jpg"), "ldr", picture, Exposure(time=1 / 60)))
        made.append(bracket)
    return made


def cameras(names):
    return [CameraRecord(name=name, serial=f"serial {name}", kind="ldr") for name in names]


# Somebody walks around a scene: the times between frames differ.
WALK = [0.0, 7.3, 12.9, 22.4, 31.0, 36.2, 47.7, 55.1]


@given(
    offset=st.floats(-1e6, 1e6),
    jitter=st.lists(st.floats(-0.3, 0.3), min_size=8, max_size=8),
    missed=st.sets(st.integers(0, 7), max_size=1),
    whole=st.booleans(),
)
@settings(max_examples=150)
def test_frames_match_whatever_the_clocks_say_and_a_missed_frame_leaves_a_gap(offset, jitter, missed, whole):
    there = [n for n in range(8) if n not in missed]
    other = [WALK[n] + offset + jitter[n] for n in there]
    matched = match_frames(cameras("ab"), [brackets(WALK, whole), brackets(other, whole)], None)
    assert matched.frames == (tuple(range(8)), tuple(there))
    assert matched.rigs == (0, 0)
    (why,) = matched.why
    assert "a, b were fired together" in why
    assert ("b lacks 1 frame;" in why) == bool(missed)
    assert "--together never" in why
    if abs(offset) > 4:
        assert f"{'ahead' if offset > 0 else 'behind'}" in why


def test_three_cameras_of_which_each_missed_another_frame():
    there = [[n for n in range(8) if n != missed] for missed in (1, 4, 6)]
    moved = [[WALK[n] + 3600.0 * index for n in frames] for index, frames in enumerate(there)]
    matched = match_frames(cameras("abc"), [brackets(times) for times in moved], None)
    assert [list(frames) for frames in matched.frames] == there
    assert matched.rigs == (0, 0, 0)


@pytest.mark.parametrize("missed", [0, 3, 7])
def test_an_intervalometer_is_matched_by_clocks_that_agree(missed):
    every = [5.0 * n for n in range(8)]
    other = [time + 0.7 for n, time in enumerate(every) if n != missed]
    matched = match_frames(cameras("ab"), [brackets(every), brackets(other)], None)
    assert matched.frames == (tuple(range(8)), tuple(n for n in range(8) if n != missed))


def test_cameras_of_two_people_share_no_frame():
    rng = np.random.default_rng(3)
    one, other = (np.cumsum(rng.uniform(5, 60, 12)).tolist() for _ in range(2))
    matched = match_frames(cameras("ab"), [brackets(one), brackets(other)], None)
    assert matched.frames == (tuple(range(12)), tuple(range(12, 24)))
    assert matched.rigs == (None, None)
    assert "a and b were fired at times of their own" in matched.why[0]


def test_one_bracket_each_is_one_frame_only_if_the_clocks_agree():
    assert match_frames(cameras("ab"), [brackets([0.0]), brackets([1.5])], None).frames == ((0,), (0,))
    assert match_frames(cameras("ab"), [brackets([0.0]), brackets([3600.0])], None).frames == ((0,), (1,))


@pytest.mark.parametrize(("ordered", "counts"), [(False, (3, 3)), (False, (1, 1)), (True, (3, 2))])
def test_without_times_cameras_share_no_frame_and_it_is_told(ordered, counts):
    pair = [brackets([None] * count) for count in counts]
    matched = match_frames(cameras("ab"), pair, None, ordered=ordered)
    assert matched.frames == (tuple(range(counts[0])), tuple(range(counts[0], sum(counts))))
    assert matched.rigs == (None, None)
    assert "Not all files have a time" in matched.why[0]
    assert "--together order" in matched.why[0]


def test_without_times_the_order_counts_where_somebody_said_that_as_many_were_there_together():
    matched = match_frames(cameras("ab"), [brackets([None] * 3), brackets([None] * 3)], None, ordered=True)
    assert matched.frames == ((0, 1, 2), (0, 1, 2))
    assert matched.rigs == (None, None)
    assert "not all files have a time" in matched.why[0]


def test_what_is_asked_for_wins():
    pair = [brackets(WALK), brackets(WALK[1:])]
    assert match_frames(cameras("ab"), pair, "order").frames == (tuple(range(8)), tuple(range(7)))
    assert match_frames(cameras("ab"), pair, "order").rigs == (0, 0)
    assert match_frames(cameras("ab"), pair, "never").frames == (tuple(range(8)), tuple(range(8, 15)))
    assert match_frames(cameras("ab"), pair, "never").rigs == (None, None)
    assert match_frames(cameras("ab"), pair, "time").frames == (tuple(range(8)), tuple(range(1, 8)))
    assert match_frames(cameras("a"), pair[:1], None).frames == (tuple(range(8)),)


@pytest.mark.parametrize("serial", ["7", "Maker M1 {}x{}"])
def test_a_camera_that_was_turned_was_not_there_twice(serial):
    sizes = [(64, 48), (48, 64)]
    turned = [
        CameraRecord(name=f"c{n}", serial=serial.format(*size), make="Maker", model="M1", kind="ldr")
        for n, size in enumerate(sizes)
    ]
    every = [5.0 * n for n in range(8)]
    later = [1000.0 + 5.0 * n for n in range(4)]
    assert match_frames(turned, [brackets(every), brackets(later)], None).frames == (
        tuple(range(8)),
        tuple(range(8, 12)),
    )


def test_long_series_are_matched_by_a_part_of_them():
    rng = np.random.default_rng(5)
    leader = np.cumsum(rng.uniform(3, 9, 6000))
    other = np.delete(leader, [10, 4000]) - 777.0 + rng.uniform(-0.3, 0.3, 5998)
    assert clock_offset(leader, other) == pytest.approx(-777.0, abs=0.1)

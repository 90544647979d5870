"""Matching of the brackets of several cameras by their clocks.

A frame is one instant of the whole rig. Camera clocks differ by an unknown constant; so
for two cameras the offset is taken at which most of their brackets coincide. A camera that missed an
instant has no bracket at that frame, and all that follow stay where they belong.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from itertools import pairwise

import numpy as np

from capture.imports.request import Together
from capture.imports.sorting.grouping import Bracket
from imaging.and_list import and_list
from imaging.arrays import Array
from imaging.session.records import CameraRecord

JITTER = 1.0
"""Seconds by which brackets of one instant differ at most: EXIF counts in whole ones."""
SHARE_OF_GAP = 0.4
"""Tolerance of a match, as a part of the shortest time between two brackets of a camera."""
SHARE_TOGETHER = 0.8
"""Share of brackets, of the camera that has fewer, that coincide if both were fired together."""
FEWEST = 3
"""Brackets that have to coincide before clocks are believed to be off; fewer coincide only if they agree."""
MOST_DIFFERENCES = 4_000_000
"""Most differences that are tried; of longer series a part gives the offset as well."""
CLOCKS_AGREE = 2.0
"""Seconds between clocks that were set by the same person."""
MOST_NAMED = 6
"""Cameras that a sentence lists."""


@dataclass(frozen=True)
class Matched:
    """frames: of each camera, the frame of each of its brackets. rigs: of each camera, the number of the
    group that was fired together with it, None if it stands alone. why: a sentence each."""

    frames: tuple[tuple[int, ...], ...]
    rigs: tuple[int | None, ...]
    why: tuple[str, ...]


def match_frames(
    cameras: Sequence[CameraRecord],
    brackets: Sequence[Sequence[Bracket]],
    together: Together | None,
    *,
    ordered: bool = False,
) -> Matched:
    """Number the frames of all cameras; by time when `together` is None.

    Args:
        cameras: Cameras.
        brackets: Brackets of each of the cameras, in the same order.
        together: Criterion that joins brackets into a frame; None: their time, if all brackets have one.
        ordered: True if the cameras are declared to have shot together, so that without times the n-th
            brackets of cameras with equal numbers are of one instant. Otherwise no two cameras share a frame.

    Returns:
        The frames of each camera's brackets, the rigs, and a sentence for each decision.
    """
    in_order = tuple(tuple(range(len(camera_brackets))) for camera_brackets in brackets)
    if len(cameras) < 2:
        return Matched(in_order, (None,) * len(cameras), ())
    times = [seconds_of(camera_brackets) for camera_brackets in brackets]
    clocked = [starts for starts in times if starts is not None]
    if together in (None, "time") and len(clocked) == len(cameras):
        return _by_time(cameras, clocked)
    sizes = [len(camera_brackets) for camera_brackets in brackets]
    if together == "never":
        return _apart(sizes)
    names = listed([camera.name for camera in cameras])
    alike = ordered and len(set(sizes)) == 1
    if together != "order" and not alike:
        why = (
            f"Not all files have a time, so that {names} share no frame; --together order takes the n-th "
            "of each for one instant."
        )
        return replace(_apart(sizes), why=(why,))
    lacking = "since not all files have a time, " if together != "order" else ""
    short = "" if len(set(sizes)) == 1 else ", although they have different numbers of them"
    why = (
        f"Frames of {names}: {lacking}the n-th of each camera are taken for one instant{short}; "
        "--together never keeps them apart."
    )
    return Matched(in_order, (0 if together == "order" else None,) * len(cameras), (why,))


def listed(names: Sequence[str]) -> str:
    """Names in a row, of many the first."""
    if len(names) > MOST_NAMED:
        return f"{', '.join(names[:MOST_NAMED])} and {len(names) - MOST_NAMED} others"
    return and_list(names)


def seconds_of(brackets: Sequence[Bracket]) -> Array | None:
    """Seconds at which each bracket began, float64 [N], rising; None if any is not known."""
    starts = []
    for bracket in brackets:
        taken = [photo.picture.metadata.captured_at for photo in bracket if photo.picture is not None]
        moments = [moment.replace(tzinfo=None) for moment in taken if moment is not None]
        if not moments:
            return None
        starts.append((min(moments) - datetime(1970, 1, 1)).total_seconds())
    return np.array(starts) if all(a <= b for a, b in pairwise(starts)) else None


def _apart(counts: Sequence[int]) -> Matched:
    first = np.concatenate([[0], np.cumsum(counts)]).astype(int).tolist()
    frames = tuple(tuple(range(start, start + count)) for start, count in zip(first, counts, strict=False))
    return Matched(frames, (None,) * len(counts), ())


def _same_body(body: CameraRecord, other: CameraRecord) -> bool:
    """Return whether two cameras of a session are one body, with pictures of two sizes or two settings of a
    lens.
    """
    unknown = all(camera.serial.startswith(f"{camera.make} {camera.model} ") for camera in (body, other))
    return body.serial == other.serial or (unknown and (body.make, body.model) == (other.make, other.model))


def _by_time(cameras: Sequence[CameraRecord], times: Sequence[Array]) -> Matched:
    """Groups of cameras that were fired together, those with most brackets first."""
    names = [camera.name for camera in cameras]
    frames: dict[int, tuple[int, ...]] = {}
    rigs: dict[int, int | None] = {}
    why: list[str] = []
    alone: list[str] = []
    remaining = sorted(range(len(times)), key=lambda index: -len(times[index]))
    first = 0
    while remaining:
        leader = remaining.pop(0)
        offsets = {leader: 0.0}
        reach = _reach([times[leader]])
        for other in list(remaining):
            if any(_same_body(cameras[other], cameras[member]) for member in offsets):
                continue  # which cannot have been there twice
            offset = clock_offset(times[leader], times[other])
            if offset is not None:
                offsets[other] = offset
                reach = min(reach, _reach([times[leader], times[other]]))
                remaining.remove(other)
        group = _instants({index: times[index] - offset for index, offset in offsets.items()}, 2 * reach)
        count = 1 + max(max(places) for places in group.values())
        for index, places in group.items():
            frames[index] = tuple(first + frame for frame in places)
            rigs[index] = first if len(group) > 1 else None
        first += count
        if len(group) > 1:
            why.append(_note(names, offsets, {index: count - len(places) for index, places in group.items()}))
        else:
            alone.append(names[leader])
    if alone:
        was, its = ("was", "its") if len(alone) == 1 else ("were", "their")
        why.append(
            f"{listed(alone)} {was} fired at times of {its} own, so that no other camera shares {its} "
            "frames; --together order shares them."
        )
    every = range(len(times))
    return Matched(tuple(frames[i] for i in every), tuple(rigs[i] for i in every), tuple(why))


def _note(names: Sequence[str], offsets: dict[int, float], missed: dict[int, int]) -> str:
    parts = [f"{', '.join(names[index] for index in offsets)} were fired together by their times"]
    parts += [
        f"the clock of {names[index]} is {abs(offset):.0f} s {'ahead' if offset > 0 else 'behind'}"
        for index, offset in offsets.items()
        if abs(offset) > CLOCKS_AGREE
    ]
    parts += [
        f"{names[index]} lacks {count} frame{'' if count == 1 else 's'}"
        for index, count in missed.items()
        if count
    ]
    return f"{', '.join(parts)}; --together never keeps them apart."


def _reach(times: Sequence[Array]) -> float:
    """Seconds within which two brackets coincide."""
    gaps = [float(np.diff(starts).min()) for starts in times if len(starts) > 1]
    return min([JITTER, *(SHARE_OF_GAP * gap for gap in gaps)])


def clock_offset(leader: Array, other: Array) -> float | None:
    """Seconds that the clock of `other` is ahead; None if the two cameras were not fired together.

    The middle of the densest cluster of differences between any two of their times; of equally dense
    ones the nearest to zero, since an intervalometer repeats itself.
    """
    reach = _reach([leader, other])
    some = other[:: 1 + len(leader) * len(other) // MOST_DIFFERENCES]
    differences = np.sort((some[:, None] - leader[None]).ravel())
    ends = np.searchsorted(differences, differences + 2 * reach + 1e-6, side="right")
    counts = ends - np.arange(len(differences))
    middles = (differences + differences[ends - 1]) / 2
    best = int(np.lexsort((np.abs(middles), -counts))[0])
    offset = float(np.median(differences[best : ends[best]]))
    fewer = min(len(leader), len(some))
    agree = abs(offset) <= CLOCKS_AGREE
    if counts[best] < SHARE_TOGETHER * fewer or not (agree or counts[best] >= FEWEST):
        return None
    return offset


def _instants(times: dict[int, Array], span: float) -> dict[int, list[int]]:
    """The frame of each time, all cameras together; times of one frame lie within `span` seconds."""
    events = sorted((float(time), index) for index, starts in times.items() for time in starts)
    frames: dict[int, list[int]] = {index: [] for index in times}
    frame, begun, present = -1, -np.inf, set(times)
    for time, index in events:
        if index in present or time - begun > span + 1e-6:
            frame, begun, present = frame + 1, time, set()
        present.add(index)
        frames[index].append(frame)
    return frames

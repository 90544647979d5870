"""Photographs of a camera sorted into brackets; each guess comes with a sentence."""

from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np

from capture.bracket.deviation import TOLERANCE_STOPS
from capture.imports.originals import Original
from imaging.and_list import and_list
from imaging.arrays import Array
from imaging.session.records import CameraRecord

DISTINCT_STOPS = 0.5
"""Two exposures of a bracket lie at least this far apart; auto exposure wanders by less between views."""

PAUSE = 30.0
"""Seconds between two photographs, beside their exposure times, that end a bracket set by hand."""

_END = f"ends at a pause of more than {PAUSE:.0f} s or where the clock goes back"

Bracket = list[Original]


@dataclass(frozen=True)
class PhotoSeries:
    """The photographs of one camera, in order."""

    camera: CameraRecord
    originals: tuple[Original, ...]


def split_into_brackets(series: PhotoSeries, count: int | None) -> tuple[list[Bracket], str]:
    """The brackets of a camera in order, one a frame, and why: every `count` photos, or guessed."""
    name, photos = series.camera.name, list(series.originals)
    if count is not None:
        brackets = [photos[start : start + count] for start in range(0, len(photos), count)]
        short = f", the last of {len(brackets[-1])}" if len(brackets[-1]) < count else ""
        return brackets, f"{name}: {_counted(len(brackets), count)}{short}, as given."
    runs = _cut(photos)
    brackets = [
        run[at : at + size] for run, cycle in runs for size in [cycle or 1] for at in range(0, len(run), size)
    ]
    sizes = sorted({len(bracket) for bracket in brackets} - {1})
    if not sizes:
        if len(photos) == 1:
            return brackets, f"{name}: the one photo is a frame of its own."
        end = f", which {_END}" if _cycle(photos, timed=False) else ""
        return brackets, (
            f"{name}: no series of exposures repeats in {len(photos)} photos, so each is a frame of its own "
            f"and none is part of a bracket{end}; --bracket N groups every N photos."
        )
    singles = len([bracket for bracket in brackets if len(bracket) == 1])
    again = " and then repeat" if any(cycle and cycle < len(run) for run, cycle in runs) else ""
    end = f", and a bracket {_END}" if len(runs) > 1 else ""
    groups = [_counted(len([b for b in brackets if len(b) == size]), size) for size in sizes]
    if singles:
        groups.append(f"{singles} single photo{'' if singles == 1 else 's'}")
    return brackets, (
        f"{name}: {and_list(groups)}, because the exposures differ by half a stop or more{again}{end}; "
        "--bracket N groups every N photos instead."
    )


def _counted(brackets: int, size: int) -> str:
    return f"{brackets} bracket{'' if brackets == 1 else 's'} of {size}"


def _cut(
    photos: list[Original], pauses: tuple[float, ...] = (2 * PAUSE, PAUSE)
) -> list[tuple[list[Original], int | None]]:
    """Photographs cut at the longest `pauses` at which a bracket repeats throughout each part, and its
    length.
    """
    cycle = _cycle(photos)
    if cycle or not pauses:
        return [(photos, cycle)]
    return [part for run in _runs(photos, pauses[0]) for part in _cut(run, pauses[1:])]


def _runs(photos: list[Original], pause: float) -> list[list[Original]]:
    """Photographs taken without such a pause, s."""
    runs = [photos[:1]]
    for before, after in pairwise(photos):
        if _wait(before, after) > pause:
            runs.append([])
        runs[-1].append(after)
    return runs


def _wait(before: Original, after: Original) -> float:
    """Seconds between two photographs beside their exposure times: 0 if not known, infinite if the clock
    goes back.
    """
    if before.picture is None or after.picture is None:
        return 0.0
    start, end = before.picture.metadata.captured_at, after.picture.metadata.captured_at
    if start is None or end is None:
        return 0.0
    exposing = sum(photo.exposure.time for photo in (before, after) if photo.exposure is not None)
    seconds = (end.replace(tzinfo=None) - start.replace(tzinfo=None)).total_seconds()
    return seconds - exposing if seconds >= -1.0 else np.inf


def _cycle(photos: list[Original], *, timed: bool = True) -> int | None:
    """The length of the bracket that repeats throughout `photos`, or None.

    A photo that could not be read fits any place; one without a known exposure fits none. Preferred
    in this order: the same exposures again and again; one series that only falls or only rises; a
    bracket that auto exposure moves as a whole from view to view; one series in any order. A bracket
    with a pause counts only if not `timed`.
    """
    count = len(photos)
    if any(photo.exposure is None for photo in photos if photo.picture is not None):
        return None
    stops = np.array([photo.exposure.stops if photo.exposure else np.nan for photo in photos])
    sizes = [size for size in range(2, count) if count % size == 0 and (size > 2 or count >= 6)]
    whole = [count] if count >= 3 else []
    candidates = [(size, False) for size in sizes]
    candidates += [(size, False) for size in whole if _is_monotone(photos)]
    candidates += [(size, True) for size in sizes if size > 2]
    candidates += [(size, False) for size in whole]
    for size, moved in candidates:
        brackets = [photos[at : at + size] for at in range(0, count, size)]
        if not _repeats(stops.reshape(-1, size), moved) or not all(map(_has_one_aperture, brackets)):
            continue
        if not timed or not any(map(_is_interrupted, brackets)):
            return size
    return None


def _repeats(stops: Array, moved: bool) -> bool:
    """Return whether the rows [brackets, steps] are one pattern of distinct exposures, each row moved or
    not.
    """
    complete = stops[~np.isnan(stops).any(axis=1)]
    if not len(complete):
        return False
    pattern = complete[0]
    if min(abs(stop - other) for stop, other in combinations(pattern, 2)) < DISTINCT_STOPS - 1e-3:
        return False
    for row in stops:
        apart = (row - pattern)[~np.isnan(row)]
        if moved:
            apart = apart - np.median(apart)
        if np.abs(apart).max(initial=0.0) > TOLERANCE_STOPS:
            return False
    return True


def _has_one_aperture(photos: list[Original]) -> bool:
    return len({photo.exposure.f_number for photo in photos if photo.exposure is not None}) == 1


def _is_interrupted(photos: list[Original]) -> bool:
    """Return whether a pause lies within a bracket.

    One series set by hand may lack an exposure, which was deleted or failed: the wait there is no pause if
    it is at most twice the longest other one.
    """
    *others, longest = sorted(_wait(before, after) for before, after in pairwise(photos))
    if longest <= PAUSE:
        return False
    lacks_one = len(photos) > 3 and others[-1] <= PAUSE and longest <= 2 * others[-1]
    return not (lacks_one and _is_monotone(photos))


def _is_monotone(photos: list[Original]) -> bool:
    """Return whether the exposures only fall or only rise."""
    rising = np.diff([photo.exposure.stops for photo in photos if photo.exposure is not None]) > 0
    return bool(rising.all() or not rising.any())

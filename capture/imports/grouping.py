"""Photographs sorted into cameras and brackets; every guess is told in a sentence."""

import re
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import combinations, pairwise
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from capture.bracket.deviation import TOLERANCE_STOPS
from capture.imports.originals import Original, shown
from imaging.session.records import CameraRecord

DISTINCT_STOPS = 0.5
"""Two exposures of a bracket lie at least this far apart; auto exposure wanders by less between views."""

PAUSE = 30.0
"""Seconds between two photographs, beside their exposure times, that end a bracket set by hand."""

Bracket = list[Original]

Identity = Literal["serial", "folder", "one"]
"""What tells photographs of one camera from those of another; one: nothing but their kind and size."""


@dataclass(frozen=True)
class PhotoSeries:
    """The photographs of one camera, in order."""

    camera: CameraRecord
    originals: tuple[Original, ...]


def sort_into_cameras(
    folder: Path,
    originals: Sequence[Original],
    by: Identity | None = None,
    lenses: Mapping[Path, str] | None = None,
    filters: frozenset[str] = frozenset(),
) -> tuple[list[PhotoSeries], list[str]]:
    """One camera a serial number, else a make and model, else a folder; sizes are never mixed.

    by: sorted by this instead. lenses: a layout's word for the camera of each photograph; it is believed
    unless `by` says otherwise, and photographs of two words are never mixed. filters: names of bands in lower
    case, whose folders are of no camera of their own. A file that could not be
    read belongs to the only camera of its folder and kind, if there is one.
    """
    members: dict[tuple[str, ...], list[Original]] = {}
    at_home: dict[tuple[Path, str], set[tuple[str, ...]]] = {}
    for original in originals:
        if original.picture is not None:
            key = _camera_key(folder, original, by, (lenses or {}).get(original.path), filters)
            members.setdefault(key, []).append(original)
            at_home.setdefault((original.path.parent, original.kind), set()).add(key)
    for original in originals:
        homes = at_home.get((original.path.parent, original.kind), set())
        if original.picture is None and len(homes) == 1:
            members[next(iter(homes))].append(original)
    place = {original.path: number for number, original in enumerate(originals)}
    names: set[str] = set()
    series: list[PhotoSeries] = []
    guesses: list[str] = []
    for key, mine in members.items():
        camera = _camera(folder, mine[0], key, names)
        ordered = sorted(mine, key=lambda original: place[original.path])
        series.append(PhotoSeries(camera, tuple(ordered if lenses else _in_time(ordered))))
        photos = "1 photo is" if len(mine) == 1 else f"{len(mine)} photos are"
        how = "as given" if by is not None else "--cameras sorts them otherwise"
        guesses.append(f"{photos} of the camera {camera.name}, by {_reason(key, by)}; {how}.")
    return series, guesses


def _in_time(photos: list[Original]) -> list[Original]:
    """In order of their times, if all that can be read tell one; counters in file names start over.

    A photo that cannot be read stays behind the one that it follows.
    """
    times: list[datetime] = []
    for photo in photos:
        moment = None if photo.picture is None else photo.picture.metadata.captured_at
        if moment is None and photo.picture is not None:
            return photos
        before = times[-1] if times else datetime.min
        times.append(before if moment is None else moment.replace(tzinfo=None))
    return [photo for _, photo in sorted(zip(times, photos, strict=True), key=lambda pair: pair[0])]


def _camera_key(
    folder: Path, original: Original, by: Identity | None, lens: str | None, filters: frozenset[str]
) -> tuple[str, ...]:
    """What makes two photographs those of one camera; its first part says by what."""
    assert original.picture is not None
    picture = original.picture
    metadata = picture.metadata
    rest = (f"{picture.width}x{picture.height}", picture.kind, lens or "")
    if by is None and lens is not None:
        return ("layout", metadata.make, metadata.model, lens, *rest)
    if by == "one":
        return ("one", "", "", "", *rest)
    if by != "folder" and metadata.serial:
        return ("serial", metadata.make, metadata.model, metadata.serial, *rest)
    if by != "folder" and (metadata.make or metadata.model):
        return ("model", metadata.make, metadata.model, "", *rest)
    home = original.path.parent.relative_to(folder)
    own = [part for part in home.parts if part.casefold() not in filters]
    return ("folder", "", "", shown(Path(*own)), *rest)


def _reason(key: tuple[str, ...], by: Identity | None) -> str:
    what = {
        "serial": f"the serial number {key[3]}",
        "model": "make and model, since the files tell no serial number",
        "folder": "their folder" if by == "folder" else "their folder, since the files tell no camera",
        "layout": f"their lens, number {key[3]} of the layout",
        "one": "their kind",
    }
    return f"{what[key[0]]}, and the size {key[4]}"


def _camera(folder: Path, first: Original, key: tuple[str, ...], taken: set[str]) -> CameraRecord:
    source, make, model, identity, size, _, lens = key
    home = folder.resolve() if identity in ("", ".") else Path(identity)
    stem = _plain(home.name if source in ("folder", "one") else model or make)
    name, number = stem, 1
    while name.casefold() in taken:
        number += 1
        name = f"{stem}-{number}"
    taken.add(name.casefold())
    described = identity if source == "serial" else f"{f'{make} {model}'.strip() or identity} {size}"
    if lens:
        described = f"{described} lens {lens}"
    return CameraRecord(name=name, serial=described, make=make, model=model, kind=first.kind)


def _plain(text: str) -> str:
    """A name that records allow: ASCII letters, digits and hyphens."""
    ascii_text = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode().lower()
    return re.sub(r"[^a-z0-9]+", "-", ascii_text).strip("-")[:40].strip("-") or "camera"


def split_into_brackets(series: PhotoSeries, count: int | None) -> tuple[list[Bracket], str]:
    """The brackets of a camera in order, one a frame, and why: every `count` photos, or guessed."""
    name, photos = series.camera.name, list(series.originals)
    if count is not None:
        brackets = [photos[start : start + count] for start in range(0, len(photos), count)]
        short = f", the last of {len(brackets[-1])}" if len(brackets[-1]) < count else ""
        return brackets, f"{name}: {_counted(len(brackets), count)}{short}, as given."
    whole = _cycle(photos)
    runs = [(photos, whole)] if whole else [(run, _cycle(run)) for run in _runs(photos)]
    brackets = [
        run[at : at + size] for run, cycle in runs for size in [cycle or 1] for at in range(0, len(run), size)
    ]
    sizes = sorted({len(bracket) for bracket in brackets} - {1})
    if not sizes:
        if len(photos) == 1:
            return brackets, f"{name}: the one photo is a frame of its own."
        return brackets, (
            f"{name}: each of {len(photos)} photos is a frame of its own, because their exposures "
            "form no bracket that repeats; --bracket N groups every N photos."
        )
    singles = len([bracket for bracket in brackets if len(bracket) == 1])
    again = " and then repeat" if len(brackets) - singles > 1 else ""
    groups = " and ".join(_counted(len([b for b in brackets if len(b) == size]), size) for size in sizes)
    rest = f" and {singles} single photos" if singles else ""
    return brackets, (
        f"{name}: {groups}{rest}, because the exposures differ by half a stop or more{again}; "
        "--bracket N groups every N photos instead."
    )


def _counted(brackets: int, size: int) -> str:
    return f"{brackets} bracket{'' if brackets == 1 else 's'} of {size}"


def _runs(photos: list[Original]) -> list[list[Original]]:
    """Photographs taken without a pause."""
    runs = [photos[:1]]
    for before, after in pairwise(photos):
        if _paused(before, after):
            runs.append([])
        runs[-1].append(after)
    return runs


def _paused(before: Original, after: Original) -> bool:
    """Whether both tell their time and lie too far apart, or in the wrong order, for one bracket."""
    if before.picture is None or after.picture is None:
        return False
    start, end = before.picture.metadata.captured_at, after.picture.metadata.captured_at
    if start is None or end is None:
        return False
    exposing = sum(photo.exposure.time for photo in (before, after) if photo.exposure is not None)
    seconds = (end.replace(tzinfo=None) - start.replace(tzinfo=None)).total_seconds()
    return not -1.0 <= seconds <= PAUSE + exposing


def _cycle(photos: list[Original]) -> int | None:
    """The length of the bracket that repeats throughout `photos`; None if there is none.

    A photo that could not be read fits any place; one without a known exposure fits none. Preferred
    in this order: the same exposures again and again; one series that only falls or only rises; a
    bracket that auto exposure moves as a whole from view to view; one series in any order.
    """
    count = len(photos)
    if any(photo.exposure is None for photo in photos if photo.picture is not None):
        return None
    stops = np.array([photo.exposure.stops if photo.exposure else np.nan for photo in photos])
    rising = np.diff(stops[~np.isnan(stops)]) > 0
    sizes = [size for size in range(2, count) if count % size == 0 and (size > 2 or count >= 6)]
    whole = [count] if count >= 3 else []
    candidates = [(size, False) for size in sizes]
    candidates += [(size, False) for size in whole if rising.all() or not rising.any()]
    candidates += [(size, True) for size in sizes if size > 2]
    candidates += [(size, False) for size in whole]
    for size, moved in candidates:
        brackets = [photos[at : at + size] for at in range(0, count, size)]
        if _repeats(stops.reshape(-1, size), moved) and all(map(_is_one_bracket, brackets)):
            return size
    return None


def _repeats(stops: npt.NDArray[np.float64], moved: bool) -> bool:
    """Whether the rows [brackets, steps] are one pattern of distinct exposures, each row moved or not."""
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


def _is_one_bracket(photos: list[Original]) -> bool:
    apertures = {photo.exposure.f_number for photo in photos if photo.exposure is not None}
    return len(apertures) == 1 and not any(_paused(before, after) for before, after in pairwise(photos))

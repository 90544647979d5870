"""Photographs sorted into cameras: a body with one setting of its lens; each guess comes with a sentence."""

import re
import unicodedata
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Literal

from capture.imports.originals import Original, copies_note, shown
from capture.imports.request import Identity
from capture.imports.sorting.clock_matching import MOST_NAMED, clock_offset, seconds_of
from capture.imports.sorting.grouping import PhotoSeries
from capture.imports.sorting.lens_settings import UNKNOWN, LensSetting, lens_settings
from capture.imports.sorting.strays import copies_among
from imaging.and_list import and_list
from imaging.session.records import CameraRecord

Source = Literal["serial", "model", "layout", "folder", "one"]


@dataclass(frozen=True)
class _Body:
    """Key of a body. identity: serial number, lens of a layout, or folder."""

    source: Source
    make: str = ""
    model: str = ""
    identity: str = ""


@dataclass(frozen=True)
class _Key:
    """Key of a camera of a session: one body, size and setting of the lens."""

    body: _Body
    kind: str
    size: tuple[int, int]
    lens: str
    setting: LensSetting


def sort_into_cameras(
    folder: Path,
    originals: Sequence[Original],
    by: Identity | None = None,
    lenses: Mapping[Path, str] | None = None,
    filters: frozenset[str] = frozenset(),
    turn: bool = True,
) -> tuple[list[PhotoSeries], list[str]]:
    """Assign a camera to each serial number, else make and model; each size and setting of the lens is one of
    its own. Of files of the same bytes in several folders, one counts where they name their camera.

    Photographs without camera metadata are of one camera, unless those of each folder are as many and their
    times agree. A file that could not be read belongs to the only camera of its folder and kind, if there is
    one.

    Args:
        folder: Folder of the import.
        originals: Photographs, in order, readable or not.
        by: Key to sort by instead of the metadata.
        lenses: A layout's word for the camera of each photograph; it is believed unless `by` says otherwise,
            and photographs of two words are never mixed.
        filters: Names of bands in lower case, whose folders are of no camera of their own.
        turn: True to turn photographs that stand upright, to lie as the others of their camera do.

    Returns:
        The photographs of each camera, and a sentence for each guess.
    """
    readable = [original for original in originals if original.picture is not None]
    apart = by == "folder" or _fired_together(folder, readable, filters)
    keys: dict[Path, _Key] = {}
    for original in readable:
        assert original.picture is not None
        lens = (lenses or {}).get(original.path)
        body = _body(folder, original, by, lens, filters, apart)
        size = (original.picture.width, original.picture.height)
        keys[original.path] = _Key(body, original.picture.kind, size, lens or "", UNKNOWN)
    notes: list[str] = []
    if lenses is None:
        keys = _with_settings(readable, keys) if by != "one" else keys
        if turn:
            readable, keys, notes = _turned(readable, keys)
    members: dict[_Key, list[Original]] = {}
    at_home: dict[tuple[Path, str], set[_Key]] = {}
    for original in readable:
        key = keys[original.path]
        members.setdefault(key, []).append(original)
        at_home.setdefault((original.path.parent, original.kind), set()).add(key)
    for original in originals:
        homes = at_home.get((original.path.parent, original.kind), set())
        if original.picture is None and len(homes) == 1:
            members[next(iter(homes))].append(original)
    if lenses is None and not filters:
        named = [mine for key, mine in members.items() if key.body.source in ("serial", "model")]
        copies = [path for mine in named for path in copies_among(mine)]
        members = {key: [one for one in mine if one.path not in copies] for key, mine in members.items()}
        notes += copies_note(folder, copies)
    place = {original.path: number for number, original in enumerate(originals)}
    names: set[str] = set()
    series: list[PhotoSeries] = []
    settings = {
        body: {key.setting for key in members if key.body == body} for body in {k.body for k in members}
    }
    for key, mine in members.items():
        ordered = sorted(mine, key=lambda original: place[original.path])
        camera = _camera(folder, mine, key, names, len(settings[key.body]) > 1)
        series.append(PhotoSeries(camera, tuple(ordered if lenses else _in_time(ordered))))
    return series, [*_guesses(list(members), series, by), *notes]


def _in_time(photos: list[Original]) -> list[Original]:
    """Sort by time, if every readable photograph has one; counters in file names start over.

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


def _body(
    folder: Path,
    original: Original,
    by: Identity | None,
    lens: str | None,
    filters: frozenset[str],
    apart: bool,
) -> _Body:
    assert original.picture is not None
    metadata = original.picture.metadata
    make, model = metadata.make, metadata.model
    if by is None and lens is not None:
        return _Body("layout", make, model, lens)
    if by == "one":
        return _Body("one")
    if by != "folder" and metadata.serial:
        return _Body("serial", make, model, metadata.serial)
    if by != "folder" and (make or model):
        return _Body("model", make, model)
    return _Body("folder", identity=_home(folder, original, filters)) if apart else _Body("one")


def _home(folder: Path, original: Original, filters: frozenset[str]) -> str:
    """The folder of a photograph without those of bands."""
    parts = original.path.parent.relative_to(folder).parts
    return shown(Path(*(part for part in parts if part.casefold() not in filters)))


def _fired_together(folder: Path, originals: Sequence[Original], filters: frozenset[str]) -> bool:
    """Return whether photographs without camera metadata lie in folders of equal size, taken at the same
    times.
    """
    homes: dict[str, list[Original]] = {}
    for original in originals:
        assert original.picture is not None
        metadata = original.picture.metadata
        if not (metadata.serial or metadata.make or metadata.model):
            homes.setdefault(_home(folder, original, filters), []).append(original)
    if len(homes) < 2 or len({len(mine) for mine in homes.values()}) > 1:
        return False
    clocks = [seconds_of([[photo] for photo in _in_time(mine)]) for mine in homes.values()]
    first, *others = clocks
    if first is None:
        return False
    return all(other is not None and clock_offset(first, other) is not None for other in others)


def _with_settings(originals: Sequence[Original], keys: Mapping[Path, _Key]) -> dict[Path, _Key]:
    """Add the setting of the lens to the keys, among the photographs of each body."""
    of_body: dict[_Body, list[Original]] = {}
    for original in originals:
        of_body.setdefault(keys[original.path].body, []).append(original)
    full: dict[Path, _Key] = {}
    for mine in of_body.values():
        settings = lens_settings([photo.picture.metadata for photo in mine if photo.picture is not None])
        for photo, setting in zip(mine, settings, strict=True):
            full[photo.path] = replace(keys[photo.path], setting=setting)
    return full


def _turned(
    originals: Sequence[Original], keys: Mapping[Path, _Key]
) -> tuple[list[Original], dict[Path, _Key], list[str]]:
    """Photographs and keys where those that a program turned lie as most others of their camera do."""
    counts = Counter(keys.values())
    now, full, notes = [], dict(keys), []
    changed: Counter[_Key] = Counter()
    for original in originals:
        key, picture = keys[original.path], original.picture
        assert picture is not None
        width, height = key.size
        other = replace(key, size=(height, width))
        fewer = (counts[key], width > height) < (counts[other], height > width)
        if width != height and counts[other] and fewer and key.kind == "ldr" and not picture.transparent:
            original = replace(original, picture=replace(picture, width=height, height=width), turned=True)
            full[original.path] = other
            changed[other] += 1
        now.append(original)
    if changed:
        count = sum(changed.values())
        photos = "1 photo lies" if count == 1 else f"{count} photos lie"
        notes.append(
            f"{photos} across the others of the same camera and size, so another program probably rotated "
            "them by 90 degrees to the right: the session has copies that are rotated back, beside the "
            "originals."
        )
    return now, full, notes


def _guesses(keys: Sequence[_Key], series: Sequence[PhotoSeries], by: Identity | None) -> list[str]:
    """Sentences for the ways in which cameras were distinguished."""
    how = "as given" if by is not None else "--cameras sorts them otherwise"
    sources = list(dict.fromkeys(key.body.source for key in keys))
    sentences = []
    for source in sources:
        mine = [(k, s) for k, s in zip(keys, series, strict=True) if k.body.source == source]
        count = sum(len(one.originals) for _, one in mine)
        photos = "1 photo is" if count == 1 else f"{count} photos are"
        if len(mine) == 1:
            key, one = mine[0]
            reason = _reason(key.body, by)
            if key.setting.known:
                reason = f"{reason.removesuffix(',')}, the lens at {key.setting}"
            sentences.append(
                f"{photos} of the camera {one.camera.name}, by {reason} and the size {_size(key)}; {how}."
            )
            continue
        named = [f"{one.camera.name} ({len(one.originals)})" for _, one in mine[:MOST_NAMED]]
        rest = f" and {len(mine) - MOST_NAMED} others" if len(mine) > MOST_NAMED else ""
        sentences.append(
            f"{photos} of {len(mine)} cameras, by {_ways([key for key, _ in mine], by)}: "
            f"{', '.join(named)}{rest}; {how}."
        )
    return sentences


def _reason(body: _Body, by: Identity | None) -> str:
    what = {
        "serial": f"the serial number {body.identity}",
        "model": "make and model, since the files have no serial number,",
        "folder": "their folder" if by == "folder" else "their folder, where counts and times agree,",
        "layout": f"their lens, number {body.identity} of the layout,",
        "one": "their kind" if by == "one" else "their kind, since the files name no camera,",
    }
    return what[body.source]


def _ways(keys: Sequence[_Key], by: Identity | None) -> str:
    """Return what several cameras of one source differ in."""
    source = keys[0].body.source
    bodies = list(dict.fromkeys(key.body for key in keys))
    numbers = [body.identity for body in bodies]
    several = len(bodies) > 1
    what = {
        "serial": f"the serial number{'s' if several else ''} {', '.join(numbers[:MOST_NAMED])}",
        "model": "make and model",
        "folder": "their folders",
        "layout": "their lenses in the layout",
        "one": "their kind",
    }
    why = {
        "model": ", since the files have no serial number",
        "folder": "" if by else ", where counts and times agree",
        "one": "" if by else ", since the files name no camera",
    }
    ways = [what[source]]
    settings = list(dict.fromkeys(key.setting for key in keys if key.setting.known))
    if len(settings) > 1:
        some = ", ".join(map(str, settings[:MOST_NAMED])) + (", ..." if len(settings) > MOST_NAMED else "")
        ways.append(f"focal length or lens ({some})")
    if len({key.size for key in keys}) > 1:
        ways.append("size")
    return and_list(ways) + why.get(source, "")


def _size(key: _Key) -> str:
    return f"{key.size[0]}x{key.size[1]}"


def _camera(
    folder: Path, photos: Sequence[Original], key: _Key, taken: set[str], several: bool
) -> CameraRecord:
    """several: whether the body has more settings of its lens than this."""
    body = key.body
    homes = {photo.path.parent for photo in photos}
    home = homes.pop() if len(homes) == 1 else folder / body.identity if body.source == "folder" else folder
    stem = _plain((body.model or body.make) if body.source not in ("folder", "one") else home.resolve().name)
    if several and key.setting.known:
        stem = f"{stem[:26].strip('-')}-{_plain(key.setting.short)[:13].strip('-')}"
    name, number = stem, 1
    while name.casefold() in taken:
        number += 1
        name = f"{stem}-{number}"
    taken.add(name.casefold())
    described = body.identity
    if body.source != "serial":
        what = f"{body.make} {body.model}".strip() or shown(home.resolve().name)
        described = f"{what} {_size(key)}"
    if several and key.setting.known and body.source != "serial":
        described = f"{described}, {key.setting}"
    if key.lens:
        described = f"{described} lens {key.lens}"
    return CameraRecord(name=name, serial=described, make=body.make, model=body.model, kind=photos[0].kind)


def _plain(text: str) -> str:
    """A name that records allow: ASCII letters, digits and hyphens."""
    ascii_text = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode().lower()
    return re.sub(r"[^a-z0-9]+", "-", ascii_text).strip("-")[:40].strip("-") or "camera"

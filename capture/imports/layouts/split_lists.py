"""Training and test views of a data set by lists of names, beside it or in its transforms.json."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Literal

from capture.imports.layouts.given import Given, GivenPhoto
from capture.imports.originals import shown
from capture.pictures.read import kind_of

Use = Literal["train", "test"]

PARTS = ("train", "val", "test")
_LISTS = ("{}.txt", "{}_list.txt", "{}_images.txt")


def with_lists(given: Given, folder: Path) -> Given:
    """The same, split by `test.txt` and its like beside it or beside the poses, if nothing else splits it.

    A line of a list is the path of a photograph, its name or that without suffix; of lists of testing alone
    all others are for training. Where less than half of the lines name a photograph, it is no list.
    """
    if any(photo.use for photo in given.photos):
        return given
    by_name = _by_name(given.photos, folder, given.images)
    strange = []
    for place in dict.fromkeys((folder, given.source if given.source.is_dir() else given.source.parent)):
        lists: dict[str, set[Path]] = {}
        for part in PARTS:
            paths = (place / form.format(part) for form in _LISTS)
            path = next((path for path in paths if path.is_file()), None)
            names = [] if path is None else _lines(path)
            photos = {by_name[name] for name in names if name in by_name}
            if names and 2 * len(photos) >= len(names):
                lists[part] = photos
            elif path is not None and 2 * sum(kind_of(Path(name)) is not None for name in names) > len(names):
                strange.append(
                    f"{shown(path)} is ignored: only {len(photos)} of the photos that it names exist."
                )
        if lists.keys() & {"val", "test"}:
            return split(given, lists, f"lists in {place.name}")
    return replace(given, notes=(*given.notes, *strange))


def split(given: Given, lists: Mapping[str, set[Path]], source: str) -> Given:
    """The same with the uses from lists of photographs, or a note that there are no such lists."""
    tests = lists.get("test") or lists.get("val") or set()
    trains = lists.get("train") or {photo.path for photo in given.photos} - tests - lists.get("val", set())
    if not tests or not trains - tests:
        note = f"The split of {source} is left out: it names no photographs to train or none to test on."
        return replace(given, notes=(*given.notes, note))

    def use(photo: GivenPhoto) -> Use | None:
        return "test" if photo.path in tests else "train" if photo.path in trains else None

    return replace(given, photos=tuple(replace(photo, use=use(photo)) for photo in given.photos))


def photos_named(given: Given, folder: Path, values: object) -> set[Path]:
    """The photographs that a list of a JSON file names, by their path or name; none where it is no list."""
    by_name = _by_name(given.photos, folder, given.images)
    names = [_plain(value) for value in values if isinstance(value, str)] if isinstance(values, list) else []
    return {by_name[name] for name in names if name in by_name}


def _by_name(photos: Iterable[GivenPhoto], folder: Path, images: Path | None) -> dict[str, Path]:
    """Photographs by what a list may call them; what would mean two is left out."""
    meant: dict[str, set[Path]] = {}
    for photo in photos:
        names = {photo.path.name, photo.path.stem}
        for root in (folder, images or folder):
            if photo.path.is_relative_to(root):
                relative = photo.path.relative_to(root)
                names |= {relative.as_posix(), relative.with_suffix("").as_posix()}
        for name in names:
            meant.setdefault(name, set()).add(photo.path)
    return {name: next(iter(paths)) for name, paths in meant.items() if len(paths) == 1}


def _lines(path: Path) -> list[str]:
    try:
        text = path.read_text(encoding="utf-8-sig", errors="replace")
    except OSError:
        return []
    lines = (_plain(line.strip()) for line in text.splitlines())
    return [line for line in lines if line and not line.startswith("#")]


def _plain(name: str) -> str:
    """A path as `_by_name` has it, whatever system wrote it."""
    return name.replace("\\", "/").removeprefix("./")

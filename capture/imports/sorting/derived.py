"""Pictures that another program made of the photographs: smaller copies, masks, thumbnails, depth maps."""

import hashlib
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from capture.pictures.read import is_without_tones, kind_of
from imaging.arrays import Array32
from imaging.errors import InputError
from imaging.files.photo import read_metadata, read_photo, read_photo_header

MASKS = re.compile(r"masks?", re.IGNORECASE)
"""Folders whose pictures are masks of the photographs of the same name."""
MADE = re.compile(
    r"(masks?|depths?|depth_?maps?|normals?|normal_?maps?|thumb(nail)?s?|previews?|segmentations?)([_-]?\d+)?",
    re.IGNORECASE,
)
"""Folders whose pictures are no photographs where photographs of the same name are elsewhere."""
NEVER = re.compile(r"@eadir|__macosx|.*\.lrdata", re.IGNORECASE)
"""Folders in which programs and servers keep pictures of their own."""

SMALLER = 0.9
"""Largest width of a copy relative to its photograph."""
MUCH_SMALLER = 0.5
"""Largest width of a copy in the folder of its photograph: a camera may make two sizes of its own."""
SAME_SHAPE = 0.02
"""Tolerance of the aspect ratio of a copy: sizes are rounded."""
ALIKE = 0.97
"""Correlation of a copy with the photograph made as small."""
_TRIED = 3
"""Pairs of two folders that are compared."""
_WIDEST = 200
_HEAD = 65536
"""Bytes at the start of a file in which photographs of equally many bytes differ."""


@dataclass(frozen=True)
class Derived:
    """Files derived from photographs. aside: pictures by the folder that they are in; masks: by
    photograph.
    """

    aside: Mapping[Path, list[Path]] = field(default_factory=dict)
    masks: Mapping[Path, Path] = field(default_factory=dict)


def find_derived(folder: Path, paths: Sequence[Path]) -> Derived:
    """Find the pictures of a folder and its subfolders that another program derived from others among
    them.
    """
    aside: dict[Path, list[Path]] = defaultdict(list)
    stems: dict[str, list[Path]] = defaultdict(list)
    for path in paths:
        if any(NEVER.fullmatch(part) for part in path.relative_to(folder).parts[:-1]):
            aside[path.parent].append(path)
        else:
            stems[path.stem.casefold()].append(path)
            if Path(path.stem).suffix:  # COLMAP's mask of a.jpg is a.jpg.png
                stems[Path(path.stem).stem.casefold()].append(path)
    pairs: dict[tuple[Path, Path], list[tuple[Path, Path]]] = defaultdict(list)
    for same in stems.values():
        for one in same:
            for other in same:
                if one.parent != other.parent and not _made(folder, other):
                    pairs[one.parent, other.parent].append((one, other))
    pictures = _Pictures()
    for (home, _), both in sorted(pairs.items()):
        tried = both[:: max(1, len(both) // _TRIED)][:_TRIED]
        if _made(folder, both[0][0]) or all(pictures.is_copy(*pair) for pair in tried):
            aside[home] += [one for one, _ in both]
    gone = {path for group in aside.values() for path in group}
    photographs_of: dict[Path, list[Path]] = defaultdict(list)
    for both in pairs.values():
        for one, other in both:
            if other not in gone and _is_mask_of(folder, one, other):
                photographs_of[one].append(other)
    return Derived(
        {home: list(dict.fromkeys(group)) for home, group in aside.items()}, _masks(folder, photographs_of)
    )


def find_copies(paths: Sequence[Path]) -> list[Path]:
    """Find the copies that lie beside their photograph: the same bytes, or a small picture without EXIF whose
    name holds the photograph's.

    The same bytes in another folder may be meant as the photograph of another camera; where they are
    `is_without_tones`, they may be another exposure.
    """
    folders: dict[Path, list[Path]] = defaultdict(list)
    for path in paths:
        folders[path.parent].append(path)
    same = [copy for group in folders.values() for copy in identical(group)]
    named: dict[tuple[Path, str], list[Path]] = defaultdict(list)
    for path in paths:
        named[path.parent, path.stem.casefold()].append(path)
    pictures = _Pictures()
    small = [
        path
        for path in paths
        if any(
            pictures.is_copy(path, photo, MUCH_SMALLER)
            for part in _parts(path.stem.casefold())
            for photo in named.get((path.parent, part), ())
        )
        and not _has_exif(path)
    ]
    return list(dict.fromkeys([*same, *small]))


def identical(paths: Sequence[Path]) -> list[Path]:
    """Every file of the same bytes as another one, but the one with the shortest name; where they are
    `is_without_tones`, none.
    """
    sizes: dict[int, list[Path]] = defaultdict(list)
    copies: list[Path] = []
    with suppress(OSError):  # what cannot be read is found out where it is read as a picture
        for path in paths:
            if size := path.stat().st_size:
                sizes[size].append(path)
        for group in sizes.values():
            for alike in _split(group, _HEAD):
                for same in _split(alike, -1):
                    original = min(same, key=lambda path: len(path.name))
                    if not _is_without_tones(original):
                        copies += [path for path in same if path != original]
    return copies


def _is_without_tones(path: Path) -> bool:
    with suppress(InputError):
        return is_without_tones(path)
    return False


def _split(paths: Sequence[Path], count: int) -> list[list[Path]]:
    """The files that share their first bytes, as many as that or all, with another one."""
    if len(paths) < 2:
        return []
    groups: dict[bytes, list[Path]] = defaultdict(list)
    for path in paths:
        with path.open("rb") as file:
            groups[hashlib.sha256(file.read(count)).digest()].append(path)
    return [group for group in groups.values() if len(group) > 1]


def _parts(stem: str) -> Iterator[str]:
    """Yield the parts of a name before and after each separator."""
    for separator in re.finditer(r"[\W_]+", stem):
        yield stem[: separator.start()]
        yield stem[separator.end() :]


def _has_exif(path: Path) -> bool:
    said = read_metadata(path)
    return bool(said.make or said.model or said.exposure or said.focal_length_mm)


def _masks(folder: Path, photographs_of: Mapping[Path, list[Path]]) -> dict[Path, Path]:
    """Choose the mask of each photograph.

    The names in a folder of one camera are those in a folder of the next, so a mask belongs to the folder
    nearest to its own, and to none where several are as near.

    Args:
        folder: Folder of the import.
        photographs_of: The photographs that each mask may belong to by its name.

    Returns:
        The mask of each photograph that has one.
    """
    chosen: list[tuple[int, Path, Path]] = []
    for mask, photos in photographs_of.items():
        distances = {photo: _distance(folder, mask, photo) for photo in photos}
        nearest = [photo for photo in photos if distances[photo] == min(distances.values())]
        if len({photo.parent for photo in nearest}) == 1:  # RAW+JPEG are two of one folder
            chosen += [(distances[photo], mask, photo) for photo in nearest]
    masks: dict[Path, Path] = {}
    for _, mask, photo in sorted(chosen):
        masks.setdefault(photo, mask)
    return masks


def _distance(folder: Path, mask: Path, photo: Path) -> int:
    """Return 0 if cam0/masks or masks/cam0 is a mask's folder and cam0 the photograph's, 1 if that is
    images/cam0 or cam0/images, else 2.
    """
    place = [part for part in mask.parent.relative_to(folder).parts if not MADE.fullmatch(part)]
    parts = photo.parent.relative_to(folder).parts
    remaining = iter(parts)
    return 0 if tuple(place) == parts else 1 if all(part in remaining for part in place) else 2


def _is_mask_of(folder: Path, path: Path, photo: Path) -> bool:
    """Return whether a picture lies among masks and has the name of the mask of a photograph."""
    made = [part for part in path.parent.relative_to(folder).parts if MADE.fullmatch(part)]
    if not made or not MASKS.fullmatch(made[-1]) or path.suffix.lower() != ".png":
        return False
    name = Path(path.stem)
    return photo.stem.casefold() in (str(name).casefold(), name.stem.casefold() if kind_of(name) else None)


def _made(folder: Path, path: Path) -> bool:
    return any(MADE.fullmatch(part) for part in path.relative_to(folder).parts[:-1])


class _Pictures:
    """Sizes and reductions of pictures, each read once: a folder is compared with many others."""

    def __init__(self) -> None:
        self._sizes: dict[Path, tuple[int, int] | None] = {}
        self._reduced: dict[tuple[Path, tuple[int, int]], Array32 | None] = {}

    def is_copy(self, small: Path, large: Path, widest: float = SMALLER) -> bool:
        """Return whether a picture shows what a larger one does; widest: relative to that."""
        one, other = self._size(small), self._size(large)
        if one is None or other is None or one[0] > widest * other[0]:
            return False
        if abs(np.log(one[1] / one[0] * other[0] / other[1])) > SAME_SHAPE:
            return False
        width = min(_WIDEST, one[0])
        size = (width, max(1, round(width * one[1] / one[0])))
        a, b = self._shrunk(small, size), self._shrunk(large, size)
        return a is not None and b is not None and _correlation(a, b) > ALIKE

    def _size(self, path: Path) -> tuple[int, int] | None:
        """Width and height by the header of a photograph; None of other files and unreadable ones."""
        if path not in self._sizes:
            self._sizes[path] = None
            if kind_of(path) == "ldr":
                with suppress(InputError, OSError):
                    self._sizes[path] = read_photo_header(path.read_bytes(), str(path))[:2]
        return self._sizes[path]

    def _shrunk(self, path: Path, size: tuple[int, int]) -> Array32 | None:
        """A photograph in grey at that width and height; None if it cannot be read."""
        if (path, size) not in self._reduced:
            self._reduced[path, size] = None
            with suppress(InputError):
                grey = read_photo(path).pixels.mean(-1)
                self._reduced[path, size] = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
        return self._reduced[path, size]


def _correlation(one: Array32, other: Array32) -> float:
    a, b = one - one.mean(), other - other.mean()
    scale = float(np.sqrt((a * a).sum() * (b * b).sum()))
    return float((a * b).sum()) / scale if scale > 0 else 0.0

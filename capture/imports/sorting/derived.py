"""Pictures that another program made of the photographs: smaller copies, masks, thumbnails, depth maps."""

import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from capture.pictures.read import kind_of
from imaging.arrays import Array32
from imaging.errors import InputError
from imaging.files.photo import read_photo

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
SAME_SHAPE = 0.02
"""Tolerance of the aspect ratio of a copy: sizes are rounded."""
ALIKE = 0.97
"""Correlation of a copy with the photograph made as small."""
_TRIED = 3
"""Pairs of two folders that are compared."""
_WIDEST = 200


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
    for (home, _), both in sorted(pairs.items()):
        tried = both[:: max(1, len(both) // _TRIED)][:_TRIED]
        if _made(folder, both[0][0]) or all(_is_copy(*pair) for pair in tried):
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


def _is_copy(small: Path, large: Path) -> bool:
    """Return whether a picture shows what a larger one does."""
    if kind_of(small) != "ldr" or kind_of(large) != "ldr":
        return False
    try:
        one, other = (read_photo(path).pixels.mean(-1) for path in (small, large))
    except InputError:
        return False
    if one.shape[1] > SMALLER * other.shape[1]:
        return False
    if abs(np.log(one.shape[0] / one.shape[1] * other.shape[1] / other.shape[0])) > SAME_SHAPE:
        return False
    width = min(_WIDEST, one.shape[1])
    size = (width, max(1, round(width * one.shape[0] / one.shape[1])))
    return _correlation(*(cv2.resize(p, size, interpolation=cv2.INTER_AREA) for p in (one, other))) > ALIKE


def _correlation(one: Array32, other: Array32) -> float:
    a, b = one - one.mean(), other - other.mean()
    scale = float(np.sqrt((a * a).sum() * (b * b).sum()))
    return float((a * b).sum()) / scale if scale > 0 else 0.0

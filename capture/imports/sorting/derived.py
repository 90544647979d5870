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
    masks: dict[Path, Path] = {}
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
        if _made(folder, both[0][0]):
            aside[home] += [one for one, _ in both]
            if MASKS.fullmatch(home.name):
                masks |= {photo: mask for mask, photo in both if mask.suffix.lower() == ".png"}
        elif all(_is_copy(*pair) for pair in both[:: max(1, len(both) // _TRIED)][:_TRIED]):
            aside[home] += [one for one, _ in both]
    gone = {path for group in aside.values() for path in group}
    return Derived(
        {home: list(dict.fromkeys(group)) for home, group in aside.items()},
        {photo: mask for photo, mask in masks.items() if photo not in gone},
    )


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

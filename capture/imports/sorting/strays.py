"""Pictures that lie among photographs without being any of theirs, such as a screenshot."""

import math
from collections.abc import Sequence
from pathlib import Path

from capture.imports.originals import Original, shown
from capture.imports.sorting.derived import identical
from imaging.optics.exposure import Exposure

MOST = 0.2
"""Part of the pictures that may be strays; more of them are photographs of another kind."""
SAME_SHAPE = 0.01
"""Difference of the logarithms of two aspect ratios that are one."""


def without_strays(originals: Sequence[Original]) -> tuple[tuple[Original, ...], list[str]]:
    """The photographs without a few of another shape that lack camera metadata, where others have it."""
    photos = [photo for photo in originals if photo.kind == "ldr" and photo.picture is not None]
    telling = [photo for photo in photos if _tells(photo)]
    shapes = [_shape(photo) for photo in telling]
    strays = [
        photo
        for photo in photos
        if not _tells(photo) and all(abs(_shape(photo) - shape) > SAME_SHAPE for shape in shapes)
    ]
    if (
        not strays
        or not telling
        or len(strays) > max(1, MOST * len(photos))
        or len(telling) < len(photos) / 2
    ):
        return tuple(originals), []
    names = ", ".join(shown(photo.path.name) for photo in strays[:3]) + (", ..." if len(strays) > 3 else "")
    files = "1 picture is" if len(strays) == 1 else f"{len(strays)} pictures are"
    note = (
        f"{files} left aside as no photograph of these cameras, of another shape and without EXIF: {names}; "
        "--cameras serial keeps it."
    )
    return tuple(photo for photo in originals if photo not in strays), [note]


def copies_among(photos: Sequence[Original]) -> list[Path]:
    """The photographs of one camera, in several folders, with the bytes and the exposure of another one; a
    list may give equal files several exposures.
    """
    if len({photo.path.parent for photo in photos}) == 1:
        return []
    alike: dict[Exposure | None, list[Path]] = {}
    for photo in photos:
        if photo.picture is not None:
            alike.setdefault(photo.exposure, []).append(photo.path)
    return [path for paths in alike.values() for path in identical(paths)]


def _tells(photo: Original) -> bool:
    """Return whether a file says anything of a camera."""
    assert photo.picture is not None
    said = photo.picture.metadata
    return bool(said.make or said.model or said.exposure or said.focal_length_mm)


def _shape(photo: Original) -> float:
    """The logarithm of the aspect ratio, of a turned picture the same."""
    assert photo.picture is not None
    return abs(math.log(photo.picture.width / photo.picture.height))

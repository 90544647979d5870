"""Files that a data set names, as programs of other systems write their names."""

import os
import unicodedata
from functools import lru_cache
from pathlib import Path

from imaging.files import store

_SUFFIXES = (".png", ".jpg", ".jpeg", ".exr", ".tif", ".tiff", ".hdr", ".dng", ".webp", ".heic", ".heif")
"""Tried in order, in small letters and in large ones, for a name without one, as Blender scenes have it."""


def file_named(folder: Path, name: str) -> Path:
    """The file in `folder` that a name means: as it stands, else with / for \\, else with its suffix added.

    Else the only one that differs in small and large letters alone, which Windows and macOS take for the
    same, or in how an accent is written. The path of the name with / where no such file is there; InputError
    where it leads out of the folder.
    """
    paths = [store.inside(folder, text) for text in dict.fromkeys((name, name.replace("\\", "/")))]
    for path in paths:
        if path.is_file():
            return path
    for path in paths:
        for suffix in _SUFFIXES:
            for ending in (suffix, suffix.upper()):
                # A dot in the name, as in frame.0001, begins no suffix.
                whole = path.with_name(path.name + ending) if path.name else path
                if whole.is_file():
                    return whole
    alike = _alike(folder, paths[-1].relative_to(folder))
    return paths[-1] if alike is None else store.inside(folder, alike.as_posix())


def _alike(folder: Path, relative: Path) -> Path | None:
    """The one file whose path is the same but for letters and accents, relative to the folder; or None."""
    match = Path()
    for part in relative.parts:
        try:
            names = _listed(folder / match, (folder / match).stat().st_mtime_ns).get(_folded(part), [])
        except OSError:  # no folder
            return None
        if len(names) != 1:
            return None
        match /= names[0]
    return match if (folder / match).is_file() else None


@lru_cache(maxsize=16)
def _listed(folder: Path, changed: int) -> dict[str, list[str]]:
    """Names in a folder by what they are without regard to letters; `changed` renews what is remembered."""
    names: dict[str, list[str]] = {}
    for name in os.listdir(folder):
        names.setdefault(_folded(name), []).append(name)
    return names


def _folded(name: str) -> str:
    return unicodedata.normalize("NFC", name).casefold()

"""Files that a data set names, as programs of other systems write their names."""

from pathlib import Path

from imaging.files import store

_SUFFIXES = (".png", ".jpg", ".jpeg", ".exr", ".tif", ".tiff", ".hdr", ".dng")
"""Tried in order, in small letters and in large ones, for a name without one, as Blender scenes have it."""


def file_named(folder: Path, name: str) -> Path:
    """The file in `folder` that a name means: as it stands, else with / for \\, else with its suffix added.

    The path of the name with / where no such file is there; InputError where it leads out of the folder.
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
    return paths[-1]

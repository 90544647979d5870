"""Folders from other programs: photographs with lenses, poses and exposures beside them.

`detect` recognises the program by the files in a folder, `read_layout` reads them. A layout only names and
describes photographs; reading and sorting them is the import's.
"""

from pathlib import Path
from typing import get_args

from capture.imports.layouts import colmap, llff, nerfstudio, openscan3
from capture.imports.layouts.datasets import hdr_nerf, hdr_pretrain, rawnerf, realx3d
from capture.imports.layouts.given import Given
from capture.imports.layouts.split_lists import with_lists
from capture.imports.request import LayoutName
from imaging.errors import InputError


def detect(folder: Path) -> LayoutName:
    """The layout of a folder; 'photos' for one that holds photographs and nothing known beside them."""
    if hdr_nerf.is_one(folder):
        return "hdr-nerf"
    if rawnerf.is_one(folder):
        return "rawnerf"
    if openscan3.is_one(folder):
        return "openscan3"
    if hdr_pretrain.is_one(folder):
        return "hdr-pretrain"
    if realx3d.is_one(folder):
        return "realx3d"
    if colmap.usual_model_folder(folder) is not None:
        return "colmap"
    if nerfstudio.is_one(folder):  # beside the model in colmap/ that it was made of
        return "nerfstudio"
    if llff.is_one(folder):
        return "llff"
    return "photos" if colmap.model_folder(folder) is None else "colmap"


def read_layout(folder: Path, name: LayoutName) -> Given | None:
    """Return the layout of a folder, or None for plain photographs.

    InputError that names the file and the place in it when it is damaged, contradicts itself or leads
    out of `folder`.
    """
    if name == "photos":
        return None
    readers = {
        "nerfstudio": nerfstudio.read,
        "colmap": colmap.read,
        "hdr-nerf": hdr_nerf.read,
        "hdr-pretrain": hdr_pretrain.read,
        "rawnerf": rawnerf.read,
        "realx3d": realx3d.read,
        "llff": llff.read,
        "openscan3": openscan3.read,
    }
    if name not in readers:
        raise InputError(f"{name!r} is not a layout: choose one of {', '.join(get_args(LayoutName))}.")
    return with_lists(readers[name](folder), folder)

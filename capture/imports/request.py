"""Options that a user gives an import."""

from dataclasses import dataclass
from os import PathLike
from typing import Annotated, Literal

from imaging.request import Request

LayoutName = Literal[
    "photos", "nerfstudio", "colmap", "hdr-nerf", "hdr-pretrain", "rawnerf", "realx3d", "llff", "openscan3"
]
Identity = Literal["serial", "folder", "one"]
"""Key that distinguishes cameras; one: only their kind and size."""
Together = Literal["time", "order", "never"]
"""Criterion that joins brackets of several cameras into one frame: their time, their order, or none."""


@dataclass(frozen=True)
class ImportRequest(Request):
    """Options of an import: the command line, Python and the benches each make one."""

    layout: Annotated[
        LayoutName | None,
        "Layout of the folder; recognised by its files if not given. Lenses, poses and scene points of a "
        "layout become the calibration of the session.",
    ] = None
    cameras: Annotated[Identity | None, "How to distinguish cameras; guessed if not given."] = None
    bracket: Annotated[int | None, "Exposures in each bracket; guessed if not given."] = None
    together: Annotated[
        Together | None, "How brackets of several cameras are matched to a frame; guessed if not given."
    ] = None
    exposures: Annotated[
        str | PathLike[str] | None, "A list 'file, seconds, f-number, ISO', an .hdrgen or image_list.txt."
    ] = None
    masks: Annotated[
        str | PathLike[str] | None,
        "A folder of PNG masks named as the photos, black where pixels are to be ignored; those of the "
        "layout if not given.",
    ] = None
    depths: Annotated[
        str | PathLike[str] | None,
        "A folder of depth maps named as the photos: 16-bit PNG in millimetres, EXR or NPY in units of the "
        "poses; those of the layout if not given.",
    ] = None
    bands: Annotated[
        str | PathLike[str] | None,
        "A list of the filters of mono cameras, one line 'name, wavelength, bandwidth' (in nm) for each; "
        "photos of a filter have its name in their file names, or are in a folder of that name.",
    ] = None
    pixel_shift: Annotated[bool, "Combine every four RAW photographs of a camera with pixel shift."] = False

"""A first guess of a lens, from what a file says about its focal length."""

from pathlib import Path

from imaging.calibration import Lens
from imaging.errors import InputError
from imaging.photo import read_metadata

USUAL = 1.2
"""Focal length over the longer side where the file is silent: COLMAP's own default."""
FULL_FRAME = 36.0
"""Width, mm, that a 35 mm equivalent focal length refers to."""


def guess_lens(file: Path, width: int, height: int) -> Lens:
    """A lens without distortion for images of `width` x `height` taken like `file`."""
    try:
        equivalent = read_metadata(file).focal_length_35mm
    except InputError:
        equivalent = None
    longer = max(width, height)
    focal = longer * (equivalent / FULL_FRAME if equivalent else USUAL)
    return Lens(
        model="SIMPLE_RADIAL", width=width, height=height, fx=focal, fy=focal, cx=width / 2, cy=height / 2
    )

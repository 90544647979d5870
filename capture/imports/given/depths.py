"""Depth maps that come with photographs: named by a layout, or in a folder beside them."""

from collections.abc import Mapping
from pathlib import Path

from capture.imports.layouts.given import GivenDepth
from capture.imports.sorting.companions import asked
from imaging.files.depth import MILLIMETRE, SUFFIXES, read_depth, require_shape

Depths = Mapping[Path, GivenDepth]
"""Depth maps by photograph."""


def depths_asked(photos: list[Path], folder: Path, depths: Path) -> Depths:
    """The depth maps in the folder that somebody named; errors as `companions.asked`."""
    paths = asked(photos, folder, depths, SUFFIXES, "depth map")
    return {photo: GivenDepth(path) for photo, path in paths.items()}


def depths_note(depths: Depths, photos: int) -> str:
    """Return how many photographs have a depth map, and what its numbers are taken for."""
    units = {depth.unit for depth in depths.values()} - {None}
    whole = f"{units.pop():g} units of the poses, as stated" if len(units) == 1 else "millimetres"
    return (
        f"{len(depths)} of {photos} photos have a depth map, whole numbers in {whole}, others in units of "
        "the poses; rig reconstruct finds the scale by scene points."
    )


def unit_of(depth: GivenDepth, height: int, width: int) -> float:
    """Length of 1 in a depth map in units of the world, once it has been read as that of such a
    photograph.

    InputError where it is damaged, no depth map, of other proportions, or says nothing anywhere.
    """
    values, whole = read_depth(depth.path)
    require_shape(depth.path, values, height, width)
    return (depth.unit or MILLIMETRE) if whole else 1.0

"""A lens taken out of a picture, and put back in: where each pixel comes from, and STMaps of it.

The straight picture is that of a pinhole of the same focal length, principal point and size. Places are
pixels, centres at +0.5; NaN where nothing is there.
"""

from pathlib import Path

import cv2
import numpy as np

from imaging.arrays import Array, Array32, Mask
from imaging.files.exr.writing import write_exr
from imaging.optics import lens as optics
from imaging.optics.lens import Lens

OUTSIDE = -1.0
"""Coordinate of an STMap where the other picture has no place: Nuke draws black there."""
_FARTHEST = 10.0
"""Tangent of the angle from the axis beyond which nothing is looked for."""


def undistorting(lens: Lens) -> Array:
    """Places in the picture as shot that the pixels of the straight one show, [H, W, 2]."""
    tangents = (_pixels(lens) - (lens.cx, lens.cy)) / (lens.fx, lens.fy)
    bent = optics.distort(tangents, lens.terms[4:], fisheye=lens.fisheye)
    places = bent * (lens.fx, lens.fy) + (lens.cx, lens.cy)
    beyond = np.linalg.norm(tangents, axis=-1) > optics.fold(lens.terms[4:], fisheye=lens.fisheye)
    places[beyond] = np.nan
    return np.asarray(places)


def redistorting(lens: Lens) -> Array:
    """Places in the straight picture that the pixels of the one as shot show, [H, W, 2]."""
    pixels = _pixels(lens)
    bent = (pixels - (lens.cx, lens.cy)) / (lens.fx, lens.fy)
    tangents = optics.undistort(bent, lens.terms[4:], fisheye=lens.fisheye)
    places = tangents * (lens.fx, lens.fy) + (lens.cx, lens.cy)
    none = ~optics.covers(lens, pixels) | (np.linalg.norm(tangents, axis=-1) > _FARTHEST)
    places[none] = np.nan
    return np.asarray(places)


def warped(picture: Array32, places: Array) -> tuple[Array32, Array32]:
    """A picture [H, W, C] at places in it, linear between its pixels; and how much of it is known, 0..1.

    What is no number counts as unknown, and what is unknown is 0: light premultiplied by the second, [H, W].
    """
    known: Mask = np.asarray(np.isfinite(picture).all(-1))
    x, y = np.moveaxis(np.nan_to_num(places - 0.5, nan=-2.0).astype(np.float32), -1, 0)
    whole = np.dstack([np.where(known[..., None], picture, 0), known]).astype(np.float32)
    drawn = cv2.remap(whole, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=0)
    return np.ascontiguousarray(drawn[..., :-1]), np.ascontiguousarray(drawn[..., -1])


def write_stmap(path: Path, places: Array, name: str) -> None:
    """Write places as an STMap: R across, G up, 0..1 from the lower left corner, of pixel centres."""
    height, width = places.shape[:2]
    across, up = places[..., 0] / width, 1 - places[..., 1] / height
    planes = {"R": across, "G": up}
    for channel, plane in planes.items():
        planes[channel] = np.nan_to_num(plane, nan=OUTSIDE).astype(np.float32)
    write_exr(path, planes, attributes={"rig:stmap": name})


def _pixels(lens: Lens) -> Array:
    across, down = np.meshgrid(np.arange(lens.width) + 0.5, np.arange(lens.height) + 0.5)
    return np.stack([across, down], axis=-1)

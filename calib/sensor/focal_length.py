"""Focal length from a photograph's metadata or the rig file, in pixels, and its error."""

import math
import tempfile
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from imaging.files.colmap import pycolmap
from imaging.files.photo import encode_jpeg
from imaging.sensor.mosaic import FrameMetadata
from imaging.session.records import CameraRecord

FULL_FRAME_DIAGONAL = math.hypot(36.0, 24.0)
"""mm; what a 35 mm equivalent focal length refers to."""
_SHAPES = 4 / 3, 3 / 2
"""Long by short side of the sensors of cameras: pictures of other shapes are cut from them."""
_OWN_SHAPE = 0.02
"""Relative, by which a picture's shape may differ from that of a sensor."""
_BUILT = 0.025
"""Relative deviation of lenses from the equivalent on their label: zooms and near focus by the most."""
_MILLIMETRES = 0.02
_TABLE = 0.03
"""The same where the sensor's size comes from the file, and from a table of models."""
_NOMINAL = 0.03
"""The same of what is printed on a lens: to 5 % by its maker, and longer the nearer it is focused."""
_EVEN = 1 / math.sqrt(3.0)
"""Standard deviation of what is spread evenly, in halves of its width."""
_DISAGREE = 3.0
"""Spreads by which two tellings may differ."""


@dataclass(frozen=True)
class FocalLength:
    """Focal length from files.

    px: at the requested size. spread: its standard deviation, relative. words: the files' statement, and its
    value in pixels.
    """

    px: float
    spread: float
    words: str

    def resized(self, factor: float) -> "FocalLength":
        """The same at another size of the picture; words stay those of the image."""
        return replace(self, px=factor * self.px)


def focal_length(metadata: FrameMetadata, width: int, height: int) -> FocalLength | None:
    """Read the focal length of a picture of this size from its metadata.

    Args:
        metadata: of the photograph.
        width: px.
        height: px.

    Returns:
        By the 35 mm equivalent and by millimetres on a sensor of known size, as well as each is known, with a
        wider spread where they contradict each other; None where neither is known.
    """
    plain = _by_millimetres(metadata, width, height)
    focal = _by_equivalent(metadata, width, height) or plain
    if focal is None:
        return None
    px, spread, words = focal.px, focal.spread, focal.words
    if plain is not None and plain is not focal:
        apart = abs(math.log(plain.px / px))
        if apart > _DISAGREE * math.hypot(plain.spread, spread):
            # The equivalent is the camera's own word; a table may have another sensor of that name.
            spread = math.hypot(spread, apart / 2)
        else:
            share = spread**2 / (spread**2 + plain.spread**2)
            # Both are rounded from one number: two of them are no surer than the better one.
            px, spread = px * (plain.px / px) ** share, min(spread, plain.spread)
            words = f"{words}, {plain.words}"
    return FocalLength(px, spread, f"{px:.0f} px ({words})")


def rig_focal_length(camera: CameraRecord) -> FocalLength | None:
    """Read the focal length that the rig file states of a camera; None where it states none."""
    if camera.focal_length is None or camera.pixel_pitch is None:
        return None
    px = 1000.0 * camera.focal_length / camera.pixel_pitch
    words = f"{camera.focal_length:g} mm before photosites {camera.pixel_pitch:g} um apart, by the rig file"
    return FocalLength(px, _NOMINAL, f"{px:.0f} px ({words})")


def _by_equivalent(metadata: FrameMetadata, width: int, height: int) -> FocalLength | None:
    """Focal length by the 35 mm equivalent, which refers to the diagonal of the sensor and is a whole
    number.
    """
    equivalent = metadata.focal_length_35mm
    if equivalent is None or not 4 < equivalent < 3000:
        return None
    diagonals = _diagonals(width, height)
    middle = math.sqrt(diagonals[0] * diagonals[-1])
    shape = _EVEN * 0.5 * math.log(diagonals[-1] / diagonals[0])
    rounded = _EVEN * 0.5 / equivalent
    # Some cameras count their digital zoom in it, and some do not.
    zoom = max(metadata.digital_zoom or 1.0, 1.0)
    zoomed = 0.5 * math.log(zoom)
    spread = math.sqrt(_BUILT**2 + shape**2 + rounded**2 + zoomed**2)
    px = equivalent / FULL_FRAME_DIAGONAL * middle * math.sqrt(zoom)
    return FocalLength(px, spread, f"{equivalent:g} mm equivalent")


def _diagonals(width: int, height: int) -> list[float]:
    """The diagonals of sensors that a picture may be cut from, px of the picture, ascending."""
    long, short = max(width, height), min(width, height)
    diagonal = math.hypot(long, short)
    if any(abs(long / short / shape - 1) < _OWN_SHAPE for shape in _SHAPES):
        return [diagonal]
    wholes = [
        math.hypot(long, long / shape) if long / short > shape else math.hypot(short * shape, short)
        for shape in _SHAPES
    ]
    return sorted([diagonal, *wholes])


def _by_millimetres(metadata: FrameMetadata, width: int, height: int) -> FocalLength | None:
    """Focal length by millimetres and the size of the sensor, from the file or pycolmap's table of
    cameras.
    """
    focal = metadata.focal_length_mm
    if focal is None or not 0.5 < focal < 3000:
        return None
    sensor, spread = metadata.sensor_mm, _MILLIMETRES
    if sensor is None:
        sensor, spread = sensor_width(metadata.make, metadata.model), _TABLE
    if sensor is None:
        return None
    zoom = max(metadata.digital_zoom or 1.0, 1.0)
    # Written with one digit behind the point, or with two.
    digits = 0.1 if abs(10 * focal - round(10 * focal)) < 1e-6 else 0.01
    spread = math.hypot(spread, _EVEN * 0.5 * digits / focal)
    px = zoom * focal / sensor * max(width, height)
    return FocalLength(px, spread, f"{focal:g} mm on a sensor {sensor:.3g} mm wide")


@cache
def sensor_width(make: str, model: str) -> float | None:
    """The width of a camera's sensor, mm, by pycolmap's table of cameras; None for an unknown model.

    pycolmap exposes it only as the focal length of a file.
    """
    if not make or not model:
        return None
    side, focal = 8, 10.0
    named = FrameMetadata(make=make, model=model, focal_length_mm=focal)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "camera.jpg"
        path.write_bytes(encode_jpeg(np.zeros((side, side), np.uint8), metadata=named))
        bitmap = pycolmap.Bitmap.read(str(path), True)
    pixels = None if bitmap is None else bitmap.exif_focal_length()
    return None if pixels is None or pixels <= 0 else focal * side / float(pixels)

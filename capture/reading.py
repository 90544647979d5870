"""One picture file read whole: what kind it is, its size, its metadata, its clipped and black shares."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from imaging.errors import InputError
from imaging.exr import read_exr
from imaging.mosaic import FrameMetadata, RawMosaic
from imaging.photo import is_photo, read_metadata, read_photo
from imaging.raw import is_raw, read_raw

Kind = Literal["raw", "ldr", "hdr"]


@dataclass(frozen=True)
class Picture:
    """A picture file that could be read to its end.

    clipped: share of the samples of red, green and blue that are at the top of the range, 0..1;
    of a mosaic each photosite counts for its own colour. black: share of all samples at or below
    the black level.
    """

    kind: Kind
    width: int
    height: int
    metadata: FrameMetadata
    clipped: tuple[float, float, float]
    black: float


def kind_of(path: Path) -> Kind | None:
    """What the suffix promises; None: not a picture that rig reads."""
    if path.suffix.lower() == ".exr":
        return "hdr"
    if is_raw(path):
        return "raw"
    return "ldr" if is_photo(path) else None


def read_picture(path: Path) -> Picture:
    """Read a whole file; InputError if it is no picture, or is torn."""
    kind = kind_of(path)
    if kind == "raw":
        mosaic = read_raw(path)
        height, width = mosaic.pixels.shape
        return Picture("raw", width, height, mosaic.metadata, *_mosaic_shares(mosaic))
    if kind == "ldr":
        photo = read_photo(path)
        height, width = photo.pixels.shape[:2]
        return Picture("ldr", width, height, photo.metadata, *_photo_shares(photo.pixels))
    if kind == "hdr":
        pixels = read_exr(path).rgb()
        height, width = pixels.shape[:2]
        black = float(np.mean(pixels <= 0))
        return Picture("hdr", width, height, read_metadata(path), (0.0, 0.0, 0.0), black)
    raise InputError(f"{path} is not a picture that rig reads: give RAW, JPEG, PNG, TIFF or EXR.")


def _mosaic_shares(mosaic: RawMosaic) -> tuple[tuple[float, float, float], float]:
    channels = mosaic.cfa.channels(*mosaic.pixels.shape)
    saturated = mosaic.saturated()
    red, green, blue = (float(np.mean(saturated[channels == channel])) for channel in range(3))
    return (red, green, blue), float(np.mean(mosaic.pixels <= mosaic.black_map()))


def _photo_shares(pixels: npt.NDArray[np.float32]) -> tuple[tuple[float, float, float], float]:
    red, green, blue = (float(share) for share in np.mean(pixels >= 1.0, axis=(0, 1)))
    return (red, green, blue), float(np.mean(pixels <= 0.0))

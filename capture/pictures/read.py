"""One picture file read whole: what kind it is, its size, its metadata, its clipped and black shares."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from capture.pictures import reduced, thumbnails
from capture.pictures.reduced import ReducedPicture
from imaging.arrays import Array32, Mask
from imaging.colour import srgb_encode
from imaging.errors import InputError
from imaging.files.exr import read_exr_header
from imaging.files.photo import Photo, is_photo, read_metadata, read_photo
from imaging.files.radiance_hdr import SUFFIX as RADIANCE
from imaging.files.radiance_hdr import Light, read_with_alpha
from imaging.files.raw import is_raw, read_raw
from imaging.merge.linear_frame import LinearFrame, from_raw
from imaging.merge.masks import without
from imaging.mosaic import FrameMetadata, RawMosaic
from imaging.session.records import ImageKind

SMALLEST = 16
"""Pixels on a side below which a picture shows nothing that could be compared."""
LIT = 0.02
"""Linear signal relative to white above which a photosite saw light, or is hot."""


@dataclass(frozen=True)
class PictureFacts:
    """A picture file that could be read to its end.

    clipped: share of the samples of red, green and blue that are at the top of the range, 0..1;
    of a mosaic each photosite counts for its own colour, one without a filter for all. black: share of all
    samples at or below the black level. lit: share of all samples clearly above it, by LIT of white.
    transparent: share of the pixels that alpha says to be so, in part or wholly. profile: name of another
    space than sRGB. doubt: the end of a sentence about what of the file was not read, or is not clear.
    """

    kind: ImageKind
    width: int
    height: int
    metadata: FrameMetadata
    clipped: tuple[float, float, float]
    black: float
    lit: float
    transparent: float = 0.0
    profile: str = ""
    doubt: str = ""


@dataclass(frozen=True)
class Examined:
    """Picture, its reduction for comparison (None if it is too small), and a thumbnail as JPEG."""

    picture: PictureFacts
    reduced: ReducedPicture | None
    thumbnail: bytes


def kind_of(path: Path) -> ImageKind | None:
    """Return the kind of picture by the suffix; None if rig does not read it."""
    if path.suffix.lower() in (".exr", RADIANCE):
        return "hdr"
    if is_raw(path):
        return "raw"
    return "ldr" if is_photo(path) else None


def read_picture(path: Path) -> PictureFacts:
    """Read a whole file; InputError if it is no picture, or is torn."""
    return _shares(path, _content(path))


def examine(path: Path, counts: Mask | None = None) -> Examined:
    """Read a whole file, for what it shows; InputError if it is no picture, or is torn.

    counts: bool [H, W], which pixels a mask lets through, the others being left out where the picture is
    compared; None, or of another size than the picture: all.
    """
    content = _content(path)
    if isinstance(content, RawMosaic):
        frame = from_raw(content, 1.0)
        picture = _of_mosaic(content, frame)
        masked = without(frame, _fitting(counts, picture))
        small = reduced.of_raw(masked, content.cfa) if _large(picture) else None
        return Examined(picture, small, thumbnails.of_raw(frame, content))
    picture = _shares(path, content)
    if isinstance(content, Photo):
        small = reduced.of_photo(content.pixels, _fitting(counts, picture)) if _large(picture) else None
        return Examined(picture, small, thumbnails.of_photo(content.pixels))
    light = content.pixels
    small = reduced.of_light(light, _fitting(counts, picture)) if _large(picture) else None
    return Examined(picture, small, thumbnails.of_light(light))


def _fitting(counts: Mask | None, picture: PictureFacts) -> Mask | None:
    return None if counts is None or counts.shape != (picture.height, picture.width) else counts


def _large(picture: PictureFacts) -> bool:
    return min(picture.width, picture.height) >= SMALLEST


def _content(path: Path) -> RawMosaic | Photo | Light:
    kind = kind_of(path)
    if kind == "raw":
        return read_raw(path)
    if kind == "ldr":
        return read_photo(path)
    if kind == "hdr":
        return read_with_alpha(path)
    raise InputError(f"{path} is not a picture that rig reads: give RAW, JPEG, PNG, TIFF, EXR or HDR.")


def _shares(path: Path, content: RawMosaic | Photo | Light) -> PictureFacts:
    if isinstance(content, RawMosaic):
        return _of_mosaic(content, from_raw(content, 1.0))
    if isinstance(content, Photo):
        height, width = content.pixels.shape[:2]
        shares = _photo_shares(content.pixels)
        return PictureFacts(
            "ldr",
            width,
            height,
            content.metadata,
            *shares,
            transparent=content.transparent,
            profile=content.profile,
            doubt=content.doubt,
        )
    height, width = content.pixels.shape[:2]
    black = float(np.mean(content.pixels <= 0))
    return PictureFacts(
        "hdr",
        width,
        height,
        read_metadata(path),
        (0.0, 0.0, 0.0),
        black,
        1.0 - black,
        transparent=content.transparent,
        doubt="" if path.suffix.lower() == RADIANCE else read_exr_header(path).doubt,
    )


def _of_mosaic(mosaic: RawMosaic, frame: LinearFrame) -> PictureFacts:
    height, width = mosaic.pixels.shape[:2]
    saturated, signal = frame.saturated, frame.signal
    cfa = mosaic.cfa
    if cfa is None:
        shares = saturated.mean((0, 1)).tolist()
        black, lit = float(np.mean(signal <= 0)), float(np.mean(signal > LIT))
        return PictureFacts(
            "raw", width, height, mosaic.metadata, (shares[0], shares[1], shares[2]), black, lit
        )
    clipped, sites = [0, 0, 0], [0, 0, 0]
    (down, across), letters = cfa.period, cfa.letters
    for (row, column), channel in np.ndenumerate(cfa.pattern):
        plane = saturated[row::down, column::across]
        # What has no filter sees all colours.
        for colour in ["RGB".find(letters[channel])] if letters[channel] != "W" else range(3):
            clipped[colour] += int(np.count_nonzero(plane))
            sites[colour] += plane.size
    red, green, blue = (count / max(every, 1) for count, every in zip(clipped, sites, strict=True))
    black, lit = np.count_nonzero(signal <= 0) / signal.size, np.count_nonzero(signal > LIT) / signal.size
    return PictureFacts("raw", width, height, mosaic.metadata, (red, green, blue), black, lit)


def _photo_shares(pixels: Array32) -> tuple[tuple[float, float, float], float, float]:
    red, green, blue = (np.count_nonzero(pixels[..., c] >= 1.0) / pixels[..., c].size for c in range(3))
    lit = np.count_nonzero(pixels > float(srgb_encode(np.array(LIT)))) / pixels.size
    return (red, green, blue), np.count_nonzero(pixels <= 0.0) / pixels.size, lit

"""One picture file read whole: its kind, size, metadata, clipped and black shares, and a thumbnail."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from capture.pictures import reduced_pictures
from capture.pictures.reduced_pictures import ReducedPicture
from imaging.arrays import AnyArray, Array32, Mask
from imaging.colour.spaces import balanced, srgb_encode
from imaging.errors import InputError
from imaging.files.exr.reading import read_exr_header
from imaging.files.photo import Photo, encode_jpeg, is_photo, read_metadata, read_photo
from imaging.files.radiance_hdr import SUFFIX as RADIANCE
from imaging.files.radiance_hdr import Light, read_with_alpha
from imaging.files.raw import is_raw, read_raw
from imaging.merge.linear_frame import LinearFrame, from_raw
from imaging.merge.masks import without
from imaging.optics.pose import upright
from imaging.sensor.cfa import cell_means
from imaging.sensor.mosaic import FrameMetadata, RawMosaic
from imaging.session.records import ImageKind

SMALLEST = 16
"""Pixels on a side below which a picture shows nothing that could be compared."""
LIT = 0.02
"""Linear signal relative to white above which a photosite saw light, or is hot."""
_END, _FEW_BETWEEN = 0.1, 0.01
"""Share of its range that counts as an end of a channel, and share of samples between the ends of a disc that
is white on black: compression leaves some at its edge."""
_LEAST_END = 0.05
"""Share of the samples that either end of such a channel has: lamps at night are fewer."""
_HOT = 0.001
"""Share of samples that may differ from all others in a picture of one colour: those of hot photosites."""


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
        small = reduced_pictures.of_raw(masked, content.cfa) if _large(picture) else None
        return Examined(picture, small, of_raw(frame, content))
    picture = _shares(path, content)
    if isinstance(content, Photo):
        small = (
            reduced_pictures.of_photo(content.pixels, _fitting(counts, picture)) if _large(picture) else None
        )
        return Examined(picture, small, of_photo(content.pixels, content.metadata.orientation))
    light = content.pixels
    small = reduced_pictures.of_light(light, _fitting(counts, picture)) if _large(picture) else None
    return Examined(picture, small, of_light(light))


def is_without_tones(path: Path) -> bool:
    """Return whether a picture shows so little that another exposure may equal it without being a copy.

    It is of one colour but for hot photosites, or white on black as in the circle of a fisheye, and has no
    noise: with noise no two exposures are equal.

    Args:
        path: Picture file.

    Returns:
        True if all channels are so; of a mosaic, each site of its tile.

    Raises:
        InputError: The file cannot be read.
    """
    return all(_is_flat(channel) or _is_black_and_white(channel) for channel in _channels(_content(path)))


def _channels(content: RawMosaic | Photo | Light) -> Iterator[AnyArray]:
    """Yield the finite samples of each channel, and of each site of a mosaic's tile."""
    pixels = content.pixels
    if isinstance(content, RawMosaic) and content.cfa is not None:
        down, across = content.cfa.period
        planes = [pixels[row::down, column::across] for row in range(down) for column in range(across)]
    else:
        planes = list(np.moveaxis(np.atleast_3d(pixels), -1, 0))
    for plane in planes:
        yield plane[np.isfinite(plane)]


def _is_flat(samples: AnyArray) -> bool:
    return not samples.size or _most_common(samples) >= 1 - _HOT


def _is_black_and_white(samples: AnyArray) -> bool:
    low, high = float(samples.min()), float(samples.max())
    edge = _END * (high - low)
    ends = samples[samples <= low + edge], samples[samples >= high - edge]
    shares = [end.size / samples.size for end in ends]
    if sum(shares) <= 1 - _FEW_BETWEEN or min(shares) < _LEAST_END:
        return False
    return all(_most_common(end) > 0.5 for end in ends)


def _most_common(samples: AnyArray) -> float:
    """Share of the samples that have the value of more than half of them; less than half if none has."""
    return float(np.mean(samples == np.median(samples)))


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


WIDTH = 160
CLIPPED_COLOUR = (255, 0, 150)
TOP = 254 / 255
QUALITY = 72


def of_raw(frame: LinearFrame, mosaic: RawMosaic) -> bytes:
    """JPEG of a mosaic and its light: white at white, its white balance, nothing lifted."""
    signal, saturated = frame.signal, frame.saturated
    rgb = balanced(cell_means(signal, mosaic.cfa), mosaic.neutral)
    clipped = cell_means(saturated, mosaic.cfa).max(-1) > 0
    return _small(rgb, clipped, orientation=mosaic.metadata.orientation)


def of_photo(pixels: Array32, orientation: int = 1) -> bytes:
    """JPEG of a developed photograph [H, W, 3], 0..1, as the camera made it, upright by its EXIF."""
    return _small(pixels, _brightest(pixels) >= TOP, developed=True, orientation=orientation)


def of_light(light: Array32) -> bytes:
    """JPEG of linear light [H, W, 3], its brightest hundredth at white: nothing is clipped in it."""
    rgb = np.nan_to_num(light, nan=0.0, posinf=0.0, neginf=0.0)
    rgb = rgb / max(float(np.percentile(rgb, 99.0)), 1e-30)
    return _small(np.asarray(rgb, np.float32), np.zeros(rgb.shape[:2], bool))


def _brightest(pixels: Array32) -> Array32:
    """The largest channel, [H, W]."""
    return np.maximum(np.maximum(pixels[..., 0], pixels[..., 1]), pixels[..., 2])


def _small(rgb: Array32, clipped: Mask, developed: bool = False, orientation: int = 1) -> bytes:
    width = min(WIDTH, rgb.shape[1])
    size = (width, max(1, round(rgb.shape[0] * width / rgb.shape[1])))
    mean = np.clip(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), 0.0, 1.0)
    share = cv2.resize(clipped.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    codes = np.rint(255 * (mean if developed else srgb_encode(mean))).astype(np.uint8)
    codes[share >= 0.5] = CLIPPED_COLOUR
    return encode_jpeg(upright(codes, orientation), QUALITY)

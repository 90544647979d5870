"""Display-referred photographs: JPEG, PNG and TIFF of 8 or 16 bits, and their EXIF."""

import logging
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import imagecodecs
import numpy as np
import numpy.typing as npt
import tifffile
from PIL import Image

from imaging.containers import (
    JPEG_MAGIC,
    PNG_MAGIC,
    Shell,
    jpeg_is_whole,
    jpeg_shell,
    png_is_whole,
    png_shell,
)
from imaging.errors import InputError
from imaging.exif import decode_exif, encode_exif, read_exif
from imaging.mosaic import FrameMetadata
from imaging.quiet import quiet
from imaging.tiff import TiffError, TiffReader

SUFFIXES = frozenset((".jpg", ".jpeg", ".png", ".tif", ".tiff"))

MOST_PIXELS = 1 << 29
"""Pixels beyond which a file is taken for damaged: twice the largest cameras there are."""

_TIFF_MAGICS = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")

# without a handler, Python would print the library's complaints about damaged files
logging.getLogger("tifffile").addHandler(logging.NullHandler())


@dataclass(frozen=True)
class Photo:
    """pixels: float32 [H, W, 3], code values divided by the largest, 0..1; bit_depth: 8 or 16.

    The pixel grid is as stored: the orientation of the metadata is not applied.
    """

    pixels: npt.NDArray[np.float32]
    bit_depth: int
    metadata: FrameMetadata = field(default_factory=FrameMetadata)


def is_photo(path: Path) -> bool:
    """Whether the suffix is one of JPEG, PNG or TIFF."""
    return path.suffix.lower() in SUFFIXES


def read_photo(path: Path) -> Photo:
    """The first image of a JPEG, PNG or TIFF file, told by its content.

    Grey becomes three equal channels, alpha is dropped, colour profiles are not applied.
    InputError if the file is none of these, is damaged or has other than 8 or 16 bits.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise _unreadable(path, error) from error
    return decode_photo(data, str(path))


def decode_photo(data: bytes, name: str) -> Photo:
    """The same of bytes in memory; `name` is what errors call them."""
    if not data:
        raise InputError(f"{name} is empty: copy it again from the camera.")
    decode = _decoder(data)
    if decode is None:
        raise InputError(f"{name} is not a JPEG, PNG or TIFF file: convert it to one of them.")
    try:
        codes = decode(data)
        largest = np.iinfo(codes.dtype).max
        pixels = _three_channels(codes).astype(np.float32) / np.float32(largest)
    except _UnfitError as error:
        raise InputError(f"{name} {error}.") from error
    except Exception as error:  # the decoders raise whatever damaged bytes make them trip over
        raise InputError(f"{name} is damaged or cut off: copy it again from the camera.") from error
    return Photo(pixels, 8 * codes.dtype.itemsize, _metadata(BytesIO(data)) or FrameMetadata())


def read_metadata(path: Path) -> FrameMetadata:
    """What any supported file (photograph, RAW, EXR) says about camera and exposure, without its pixels.

    InputError if there is no such file or it is of no kind that rig reads.
    """
    from imaging import exr, raw  # they load LibRaw and OpenEXR, which a photograph does not need

    if raw.is_raw(path):
        return raw.read_raw_metadata(path)
    if path.suffix.lower() == ".exr":
        return FrameMetadata(exposure=exr.read_exr_header(path).exposure)
    try:
        with path.open("rb") as file:
            metadata = _metadata(file)
    except OSError as error:
        raise _unreadable(path, error) from error
    if metadata is None:
        raise InputError(f"{path} is no photograph, RAW or EXR file: convert it to one of them.")
    return metadata


def encode_jpeg(
    pixels: npt.NDArray[np.uint8], quality: int = 95, metadata: FrameMetadata | None = None
) -> bytes:
    """JPEG bytes of uint8 [H, W, 3] or [H, W], colour not subsampled, with EXIF if there is metadata."""
    if pixels.dtype != np.uint8:
        raise ValueError(f"a JPEG has uint8 pixels, not {pixels.dtype}")
    extra = {} if metadata is None else {"exif": encode_exif(metadata)}
    buffer = BytesIO()
    image = Image.fromarray(np.ascontiguousarray(pixels))
    image.save(buffer, "JPEG", quality=quality, subsampling=0, **extra)
    return buffer.getvalue()


def encode_png(pixels: npt.NDArray[np.uint8] | npt.NDArray[np.uint16]) -> bytes:
    """PNG bytes of uint8 or uint16 [H, W] or [H, W, 3], red first."""
    if pixels.dtype not in (np.uint8, np.uint16):
        raise ValueError(f"a PNG has uint8 or uint16 pixels, not {pixels.dtype}")
    return bytes(imagecodecs.png_encode(np.ascontiguousarray(pixels)))


class _UnfitError(Exception):
    """A sound file of a kind that is not read; the message ends the sentence that the path begins."""


def _unreadable(path: Path, error: OSError) -> InputError:
    reason = (error.strerror or str(error)).lower()
    return InputError(f"{path} cannot be read ({reason}): correct the path or its permissions.")


def _decoder(data: bytes) -> Any:
    if data.startswith(JPEG_MAGIC):
        return _jpeg
    if data.startswith(PNG_MAGIC):
        return _png
    return _tiff if data.startswith(_TIFF_MAGICS) else None


def _three_channels(codes: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """[H, W, 3] of [H, W] or [H, W, C]; one channel is grey, a second or fourth is alpha."""
    if codes.ndim == 2:
        codes = codes[..., None]
    if codes.ndim != 3 or codes.size == 0:
        raise ValueError("no image")
    return codes[..., :3] if codes.shape[2] >= 3 else codes[..., :1].repeat(3, axis=2)


def _check_size(width: int, height: int) -> None:
    """A damaged header asks for more memory than there is."""
    if not 0 < width * height <= MOST_PIXELS:
        raise ValueError("no plausible size")


def _jpeg(data: bytes) -> npt.NDArray[Any]:
    shell = jpeg_shell(BytesIO(data))
    _check_size(shell.width, shell.height)
    if not jpeg_is_whole(data):
        raise ValueError("cut off")
    with quiet():
        codes = np.asarray(imagecodecs.jpeg8_decode(data))
    if codes.dtype != np.uint8 or (codes.ndim == 3 and codes.shape[2] not in (1, 3)):
        raise _UnfitError("is a JPEG of other than 8-bit grey or RGB: convert it to 8-bit RGB")
    return codes


def _png(data: bytes) -> npt.NDArray[Any]:
    shell = png_shell(BytesIO(data))
    _check_size(shell.width, shell.height)
    if not png_is_whole(BytesIO(data)):
        raise ValueError("cut off")
    with quiet():
        return np.asarray(imagecodecs.png_decode(data))


def _tiff(data: bytes) -> npt.NDArray[Any]:
    with tifffile.TiffFile(BytesIO(data)) as file:
        page = file.pages.first
        if page.photometric not in (0, 1, 2, 6):
            raise _UnfitError("is a TIFF that is neither grey nor RGB: convert it to RGB")
        if page.dtype not in (np.uint8, np.uint16) or page.bitspersample not in (8, 16):
            raise _UnfitError("is a TIFF of other than 8 or 16 bits: convert it to one of them")
        _check_size(page.imagewidth, page.imagelength)
        _check_extents(page, len(data))
        codes = np.asarray(page.asarray())
    if page.axes.startswith("S"):  # planes
        codes = np.moveaxis(codes, 0, -1)
    codes = codes.astype(codes.dtype.newbyteorder("="))
    return np.iinfo(codes.dtype).max - codes if page.photometric == 0 else codes


def _check_extents(page: Any, size: int) -> None:
    """Whether every strip and tile of the page is there: tifffile fills missing ones with zeros."""
    sizes = page.databytecounts
    ends = [start + length for start, length in zip(page.dataoffsets, sizes, strict=True)]
    if len(ends) < np.prod(page.chunked) or not ends or max(ends) > size or 0 in sizes:
        raise ValueError("cut off")
    if page.compression == 1 and sum(sizes) < page.nbytes:
        raise ValueError("cut off")


def _metadata(file: BinaryIO) -> FrameMetadata | None:
    """EXIF of an open JPEG, PNG or TIFF, empty if it has none or damaged; None if it is no such file."""
    head = file.read(12)
    shell: Shell
    if head.startswith(JPEG_MAGIC):
        shell = jpeg_shell(file)
    elif head.startswith(PNG_MAGIC):
        shell = png_shell(file)
    elif head.startswith(_TIFF_MAGICS):
        try:
            return read_exif(TiffReader(file))
        except TiffError:
            return FrameMetadata()
    else:
        return None
    return decode_exif(shell.exif) if shell.exif else FrameMetadata()

"""Display-referred photographs: JPEG, PNG and TIFF of 8 or 16 bits, and their EXIF."""

import logging
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import imagecodecs
import numpy as np
import numpy.typing as npt
import tifffile
from PIL import Image
from PIL.JpegImagePlugin import JpegImageFile

from imaging.errors import InputError
from imaging.exif import decode_exif, encode_exif, read_exif
from imaging.mosaic import FrameMetadata
from imaging.quiet import quiet
from imaging.tiff import TiffError

SUFFIXES = frozenset((".jpg", ".jpeg", ".png", ".tif", ".tiff"))

_JPEG, _PNG, _TIFF = b"\xff\xd8\xff", b"\x89PNG\r\n\x1a\n", (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")

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
    data = _read(path)
    try:
        if data.startswith(_JPEG):
            codes = _jpeg(data)
        elif data.startswith(_PNG):
            codes = _png(data)
        elif data.startswith(_TIFF):
            codes = _tiff(data)
        else:
            raise InputError(f"{path} is not a JPEG, PNG or TIFF file: convert it to one of them.")
    except _Unfit as error:
        raise InputError(f"{path} {error}.") from error
    except InputError:
        raise
    except Exception as error:  # the decoders raise whatever damaged bytes make them trip over
        raise InputError(f"{path} is damaged or cut off: copy it again from the camera.") from error
    if codes.ndim == 2:
        codes = codes[..., None]
    codes = codes[..., :3] if codes.shape[2] >= 3 else codes[..., :1].repeat(3, axis=2)
    if codes.dtype not in (np.uint8, np.uint16) or codes.size == 0:
        raise InputError(f"{path} has pixels of type {codes.dtype}: convert it to 8 or 16 bits.")
    largest = np.iinfo(codes.dtype).max
    pixels = np.ascontiguousarray(codes, np.float32) / np.float32(largest)
    return Photo(pixels, 8 * codes.dtype.itemsize, _metadata(BytesIO(data)))


def read_metadata(path: Path) -> FrameMetadata:
    """What any supported file (photograph, RAW, EXR) says about camera and exposure, without its pixels.

    InputError if there is no such file or it is of no kind that rig reads.
    """
    from imaging import exr, raw  # they load LibRaw and OpenEXR, which a photograph does not need

    if raw.is_raw(path):
        return raw.read_raw_metadata(path)
    if path.suffix.lower() == ".exr":
        return FrameMetadata(exposure=exr.read_exr_header(path).exposure)
    if not is_photo(path):
        raise InputError(f"{path} is no photograph, RAW or EXR file: name one.")
    try:
        with path.open("rb") as file:
            return _metadata(file)
    except OSError as error:
        raise _unreadable(path, error) from error


def encode_jpeg(
    pixels: npt.NDArray[np.uint8], quality: int = 95, metadata: FrameMetadata | None = None
) -> bytes:
    """JPEG bytes of uint8 [H, W, 3] or [H, W], colour not subsampled, with EXIF if there is metadata."""
    if pixels.dtype != np.uint8:
        raise ValueError(f"a JPEG has uint8 pixels, not {pixels.dtype}")
    extra = {} if metadata is None else {"exif": encode_exif(metadata)}
    buffer = BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels)).save(
        buffer, "JPEG", quality=quality, subsampling=0, **extra
    )
    return buffer.getvalue()


def encode_png(pixels: npt.NDArray[np.uint8] | npt.NDArray[np.uint16]) -> bytes:
    """PNG bytes of uint8 or uint16 [H, W] or [H, W, 3], red first."""
    if pixels.dtype not in (np.uint8, np.uint16):
        raise ValueError(f"a PNG has uint8 or uint16 pixels, not {pixels.dtype}")
    return bytes(imagecodecs.png_encode(np.ascontiguousarray(pixels)))


class _Unfit(Exception):
    """A sound file of a kind that is not read; the message ends the sentence that the path begins."""


def _unreadable(path: Path, error: OSError) -> InputError:
    reason = (error.strerror or str(error)).lower()
    return InputError(f"{path} cannot be read ({reason}): correct the path or its permissions.")


def _read(path: Path) -> bytes:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise _unreadable(path, error) from error
    if not data:
        raise InputError(f"{path} is empty: copy it again from the camera.")
    return data


def _jpeg(data: bytes) -> npt.NDArray[Any]:
    # the class itself, and not Image.open: no warning about large images, no other format
    with JpegImageFile(BytesIO(data)) as image:
        return np.asarray(image if image.mode in ("L", "RGB") else image.convert("RGB"))


def _png(data: bytes) -> npt.NDArray[Any]:
    with quiet():
        return np.asarray(imagecodecs.png_decode(data))


def _tiff(data: bytes) -> npt.NDArray[Any]:
    with tifffile.TiffFile(BytesIO(data)) as file:
        page = file.pages.first
        if page.photometric not in (0, 1, 2, 6):
            raise _Unfit("is a TIFF that is neither grey nor RGB: convert it to RGB")
        _check_extents(data, page)
        codes = np.asarray(page.asarray())
    codes = codes.astype(codes.dtype.newbyteorder("="))
    if page.axes.startswith("S"):
        codes = np.moveaxis(codes, 0, -1)
    if (
        codes.dtype not in (np.uint8, np.uint16)
        or page.bitspersample not in (8, 16)
        or codes.ndim not in (2, 3)
    ):
        raise _Unfit("is a TIFF of other than 8 or 16 bits: convert it")
    return np.iinfo(codes.dtype).max - codes if page.photometric == 0 else codes


def _check_extents(data: bytes, page: Any) -> None:
    """Whether every strip and tile lies in the file: tifffile fills missing ones with zeros."""
    ends = [start + size for start, size in zip(page.dataoffsets, page.databytecounts, strict=True)]
    if not ends or max(ends) > len(data) or 0 in page.databytecounts:
        raise ValueError("cut off")


def _metadata(file: BinaryIO) -> FrameMetadata:
    """EXIF of an open JPEG, PNG or TIFF; empty if there is none or it is damaged."""
    head = file.read(12)
    if head.startswith(_JPEG):
        return next(
            (decode_exif(b) for b in _jpeg_segments(file) if b.startswith(b"Exif\0\0")), FrameMetadata()
        )
    if head.startswith(_PNG):
        return next((decode_exif(b) for b in _png_exif(file)), FrameMetadata())
    try:
        return read_exif(file)
    except TiffError:
        return FrameMetadata()


def _jpeg_segments(file: BinaryIO) -> Iterator[bytes]:
    """The APP1 segments before the first scan."""
    file.seek(2)
    while True:
        marker = file.read(4)
        if len(marker) < 4 or marker[0] != 0xFF or marker[1] in (0xD9, 0xDA):
            return
        length = struct.unpack(">H", marker[2:])[0] - 2
        if length < 0:
            return
        if marker[1] == 0xE1:
            yield file.read(length)
        else:
            file.seek(length, 1)


def _png_exif(file: BinaryIO) -> Iterator[bytes]:
    """The eXIf chunks."""
    file.seek(8)
    while len(head := file.read(8)) == 8:
        length, kind = struct.unpack(">I4s", head)
        if kind == b"eXIf" and length < 1 << 20:
            yield file.read(length)
            file.seek(4, 1)
        else:
            file.seek(length + 4, 1)

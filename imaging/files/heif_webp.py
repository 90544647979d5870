"""HEIF (HEIC) and WebP photographs: code values of 8 bits, EXIF and colour profile.

HEIF needs the package pillow-heif. It shows pictures upright; those of telephones that stand so by their EXIF
are laid back, since the pixel grid of a photograph is that of the sensor. WebP: RFC 9649.
"""

import importlib.util
import struct
from collections.abc import Iterator
from dataclasses import dataclass, replace
from io import BytesIO
from typing import Any

import imagecodecs
import numpy as np
from PIL import Image

from imaging.arrays import Bytes
from imaging.compute.memory import check_picture
from imaging.files.tags.xmp import noted
from imaging.files.tiff.exif import decode_exif
from imaging.sensor.mosaic import FrameMetadata

WEBP_SUFFIXES = frozenset((".webp",))
HEIF_SUFFIXES = frozenset((".heic", ".heif", ".hif"))

_BRANDS = (b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1")
_AVIF = {b"avif", b"avis"}
_BACK = {6: 1, 8: -1}
"""Quarter turns to the left that lay back a picture of this orientation that stands upright."""


@dataclass(frozen=True)
class Wrapped:
    """Contents of a HEIF or WebP file. codes: uint8 [H, W, C]."""

    codes: Bytes
    metadata: FrameMetadata


def heif_is_read() -> bool:
    """Return whether the package for HEIF is installed."""
    return importlib.util.find_spec("pillow_heif") is not None


def is_heif(data: bytes) -> bool:
    """Return whether bytes begin as a HEIF file of HEVC pictures."""
    return data[4:8] == b"ftyp" and data[8:12] in _BRANDS and not is_avif(data)


def is_avif(data: bytes) -> bool:
    """Return whether bytes begin as an AVIF file, by its own brand or beside HEIF's plain one."""
    length = int.from_bytes(data[:4])
    brands = {data[at : at + 4] for at in (8, *range(16, min(length, 256), 4))}
    return data[4:8] == b"ftyp" and bool(brands & _AVIF) and not brands & {b"heic", b"heix"}


def is_webp(data: bytes) -> bool:
    """Return whether bytes begin as a WebP file."""
    return data[:4] == b"RIFF" and data[8:12] == b"WEBP"


def decode_webp(data: bytes, name: str) -> Wrapped:
    """A WebP file; ValueError where it is cut off, InputError where it takes more memory than there is."""
    if struct.unpack("<I", data[4:8])[0] + 8 > len(data):
        raise ValueError("cut off")
    with Image.open(BytesIO(data)) as shell:
        check_picture(name, *shell.size)
    codes = np.asarray(imagecodecs.webp_decode(data), np.uint8)
    return Wrapped(codes, webp_metadata(data))


def webp_metadata(data: bytes) -> FrameMetadata:
    """Return what the EXIF and the XMP of a WebP file say."""
    return noted(decode_exif(_chunk(data, b"EXIF")), _chunk(data, b"XMP "))


def decode_heif(data: bytes, name: str) -> Wrapped:
    """A HEIF file, its first picture; errors as `decode_webp`, and those of its package."""
    image = _heif(data)
    check_picture(name, *image.size)
    codes = np.asarray(image)
    metadata, turns = _laid_back(image)
    return Wrapped(np.rot90(codes, turns), metadata)


def heif_metadata(data: bytes) -> FrameMetadata:
    """Read the EXIF and XMP of a HEIF file, with the orientation of the stored picture."""
    return _laid_back(_heif(data))[0]


def embedded_icc(data: bytes) -> bytes:
    """The colour profile in a WebP file; b"" for none."""
    return _chunk(data, b"ICCP")


def heif_colour(data: bytes) -> tuple[bytes, bytes]:
    """The colour profile in a HEIF file, and its `nclx` as four bytes of ITU-T H.273; each b"" for none.

    The decoder has turned Y, Cb and Cr of any range into RGB of the full one, so the last two of the numbers
    are those of RGB.
    """
    info = _heif(data).info
    profile = info.get("nclx_profile") or {}
    primaries, transfer = (profile.get(name) for name in ("color_primaries", "transfer_characteristics"))
    numbers = b""
    if isinstance(primaries, int) and isinstance(transfer, int):
        numbers = bytes((primaries & 255, transfer & 255, 0, 1))
    return info.get("icc_profile") or b"", numbers


def _heif(data: bytes) -> Any:
    import pillow_heif

    return pillow_heif.open_heif(BytesIO(data), convert_hdr_to_8bit=True)


def _laid_back(image: Any) -> tuple[FrameMetadata, int]:
    metadata = noted(decode_exif(image.info.get("exif") or b""), image.info.get("xmp") or b"")
    width, height = image.size
    turns = _BACK.get(metadata.orientation, 0) if height > width else 0
    return (metadata if turns else replace(metadata, orientation=1)), turns


def _chunk(data: bytes, kind: bytes) -> bytes:
    return next((body for name, body in _chunks(data) if name == kind), b"")


def _chunks(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    position = 12
    while position + 8 <= len(data):
        kind, length = struct.unpack("<4sI", data[position : position + 8])
        yield kind, data[position + 8 : position + 8 + length]
        position += 8 + length + length % 2

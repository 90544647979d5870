"""Photographs that a program turned, turned back to lie as the camera took them, without loss."""

import struct
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np

from imaging.files.photo import decode_codes, decode_photo, encode_png
from imaging.files.tags.icc import profile_of
from imaging.files.tiff.exif import encode_exif

_AFTER_HEADER = 8 + 12 + 13
"""Bytes of a PNG file up to the end of its first chunk."""
_UPRIGHT_TO_THE_RIGHT = 6
"""The orientation of EXIF that shows the turned picture upright."""


def turned_back(data: bytes, name: str) -> bytes:
    """A photograph as PNG, turned by a quarter to the left, with its EXIF; InputError as `decode_photo`.

    The code values stay. What is in another colour space is turned in sRGB, of 16 bits.
    """
    photo = decode_photo(data, name)
    codes = decode_codes(data, name)
    if codes.shape[2] >= 3 and profile_of(data) is not None:
        codes = np.rint(65535 * photo.pixels.clip(0.0, 1.0)).astype(np.uint16)
    png = encode_png(np.rot90(codes[..., :3] if codes.shape[2] >= 3 else codes[..., 0]))
    metadata = replace(photo.metadata, orientation=_UPRIGHT_TO_THE_RIGHT)
    exif = _chunk(b"eXIf", encode_exif(metadata).removeprefix(b"Exif\0\0"))
    return png[:_AFTER_HEADER] + exif + png[_AFTER_HEADER:]


def mask_turned_back(path: Path) -> bytes:
    """A mask as PNG, turned in the same way; InputError as `decode_codes`."""
    codes = decode_codes(
        path.read_bytes(), f"The mask {path}", "make it again as a PNG, black where to ignore"
    )
    if codes.shape[2] == 2:
        codes = np.where(codes[..., 1:] > 0, codes[..., :1], 0)
    return encode_png(np.rot90(codes[..., 0] if codes.shape[2] == 1 else codes))


def _chunk(kind: bytes, data: bytes) -> bytes:
    body = kind + data
    return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))

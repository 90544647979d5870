"""EXIF of RAW files that are no TIFF: CR3, RAF, ORF, RW2."""

import logging
import struct
from dataclasses import replace
from io import BytesIO
from typing import BinaryIO

import exifread
import rawpy
from exifread.core.exceptions import ExifError

from imaging.files.jpeg_png import jpeg_shell
from imaging.files.tiff.exif import decode_exif, from_names
from imaging.optics.exposure import Exposure
from imaging.sensor.mosaic import FrameMetadata

_EXIFREAD_ERRORS = (
    ExifError,
    ArithmeticError,
    AssertionError,
    AttributeError,
    LookupError,
    OSError,
    RecursionError,
    TypeError,
    ValueError,
    struct.error,
)
_LARGEST_HEAD = 1 << 18
"""Bytes of a photograph that its EXIF, of at most 65,535, stands in."""

# without a handler, Python would print the library's complaints about damaged files
logging.getLogger("exifread").addHandler(logging.NullHandler())


def spoken(file: BinaryIO, raw: rawpy.RawPy) -> FrameMetadata:
    """Metadata of containers that are no TIFF (CR3, RAF, ORF, RW2): their EXIF, else LibRaw's."""
    metadata = _exif_of_raf(file)
    if metadata is None:
        try:
            tags = exifread.process_file(file, details=False)
        except _EXIFREAD_ERRORS:  # of bytes that are damaged
            tags = {}
        metadata = from_names({name: getattr(tag, "values", ()) for name, tag in tags.items()})
    other = raw.other
    exposure = None
    if other.shutter_speed > 0:
        exposure = Exposure(
            time=other.shutter_speed,
            f_number=other.aperture if other.aperture > 0 else None,
            iso=other.iso_speed if other.iso_speed > 0 else None,
        )
    return replace(
        metadata,
        exposure=metadata.exposure or exposure,
        focal_length_mm=metadata.focal_length_mm or other.focal_length or None,
    )


def _exif_of_raf(file: BinaryIO) -> FrameMetadata | None:
    """EXIF of a Fujifilm file, from the photograph that its head points to; None for any other file."""
    head = file.read(92)
    file.seek(0)
    if not head.startswith(b"FUJIFILMCCD-RAW") or len(head) < 92:
        return None
    start, length = struct.unpack(">II", head[84:])
    file.seek(start)
    return decode_exif(jpeg_shell(BytesIO(file.read(min(length, _LARGEST_HEAD)))).exif)

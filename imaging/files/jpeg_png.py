"""Container of JPEG and PNG files: size, EXIF, XMP, and whether the end of the file is present.

The decoders fill what is missing with grey, so completeness is checked here.
"""

import re
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO

from imaging.files.tags.xmp import MARK

JPEG_MAGIC, PNG_MAGIC = b"\xff\xd8\xff", b"\x89PNG\r\n\x1a\n"

_MARKER = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")
"""Marker in entropy-coded data: anything but a stuffed 0xFF, a restart and a fill byte."""

_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_SCAN, _END, APP1 = 0xDA, 0xD9, 0xE1
_PNG_XMP = b"XML:com.adobe.xmp\0"


@dataclass(frozen=True)
class Shell:
    """Container data. width, height: px, 0 if unknown; exif: the EXIF block, xmp: the XMP packet, b'' if
    absent.
    """

    width: int = 0
    height: int = 0
    exif: bytes = b""
    xmp: bytes = b""


def jpeg_shell(file: BinaryIO) -> Shell:
    """Return what the segments before the first scan of an open JPEG file say; empty where it is damaged."""
    width = height = 0
    exif = xmp = b""
    for kind, length in _before_scan(file):
        if kind == APP1:
            block = file.read(length)
            exif = exif or (block if block.startswith(b"Exif\0\0") else b"")
            xmp = xmp or (block if block.startswith(MARK) else b"")
        elif kind in _FRAMES and length >= 5:
            height, width = struct.unpack(">HH", file.read(5)[1:].ljust(4, b"\0"))
    return Shell(width, height, exif, xmp)


def jpeg_segments(file: BinaryIO, marker: int) -> Iterator[bytes]:
    """The bodies of the segments of one kind before the first scan of an open JPEG file."""
    for kind, length in _before_scan(file):
        if kind == marker:
            yield file.read(length)


def _before_scan(file: BinaryIO) -> Iterator[tuple[int, int]]:
    """Marker and length of every segment before the first scan; the file stands at its body."""
    position = 2
    while file.seek(position) == position and len(head := file.read(4)) == 4 and head[0] == 0xFF:
        if head[1] == 0xFF:  # a fill byte, of which any number may stand before a marker
            position += 1
            continue
        length = struct.unpack(">H", head[2:])[0] - 2
        if head[1] in (_SCAN, _END) or length < 0:
            return
        yield head[1], length
        position += 4 + length


def jpeg_is_whole(data: bytes) -> bool:
    """Return whether the scans of a JPEG file go on to its end marker."""
    position = 2
    while position + 4 <= len(data) and data[position] == 0xFF:
        marker = data[position + 1]
        if marker == 0xFF:  # fill
            position += 1
            continue
        if marker == _END:
            return True
        position += 2 + int(struct.unpack(">H", data[position + 2 : position + 4])[0])
        if marker == _SCAN:
            match = _MARKER.search(data, position)
            if match is None:
                return False
            position = match.start()
    return data[position : position + 2] == b"\xff\xd9"


def png_shell(file: BinaryIO) -> Shell:
    """Return what the chunks of an open PNG file say; empty where it is damaged."""
    width = height = 0
    exif = xmp = b""
    for kind, length in png_chunks(file):
        if kind == b"IHDR" and length >= 8:
            width, height = struct.unpack(">II", file.read(8).ljust(8, b"\0"))
        elif kind == b"eXIf" and length <= 1 << 20:
            exif = file.read(length)
        elif kind == b"iTXt" and length <= 1 << 20:
            xmp = xmp or _xmp_of(file.read(length))
    return Shell(width, height, exif, xmp)


def _xmp_of(text: bytes) -> bytes:
    """The packet in an iTXt chunk; b'' where it is another text, or damaged."""
    if not text.startswith(_PNG_XMP):
        return b""
    packed, rest = text[len(_PNG_XMP) : len(_PNG_XMP) + 1], text[len(_PNG_XMP) + 2 :]
    body = rest.split(b"\0", 2)[-1]  # behind the language and the keyword in it
    try:
        return zlib.decompressobj().decompress(body, 1 << 22) if packed == b"\1" else body
    except zlib.error:
        return b""


def png_is_whole(file: BinaryIO) -> bool:
    """Return whether the chunks of a PNG file go on to its end chunk."""
    size = file.seek(0, 2)
    return any(kind == b"IEND" and file.tell() + 4 <= size for kind, _ in png_chunks(file))


def png_chunks(file: BinaryIO) -> Iterator[tuple[bytes, int]]:
    """Kind and length of every chunk; the file stands at its data."""
    position = 8
    while file.seek(position) == position and len(head := file.read(8)) == 8:
        length, kind = struct.unpack(">I4s", head)
        yield kind, length
        if kind == b"IEND":
            return
        position += 12 + length

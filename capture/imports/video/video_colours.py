"""Colour that a video states: in its container (MP4, MOV, Matroska, WebM), and in its stream of pictures.

A file may say it in either, in both, or not at all. Only what a print can show is taken: the pictures of a
video have no light beyond white, so that those of HDR would be read as another scene.
"""

import re
from collections.abc import Iterator
from pathlib import Path

from capture.imports.video.stream_colours import UNSAID, Colours, stream_colours
from imaging.errors import InputError
from imaging.files.tags.cicp import UNSPECIFIED, name_of, refuse_hdr

_NARROW = (1, UNSPECIFIED, 5, 6, 7)
"""ColourPrimaries whose colours are those of sRGB, or nearly."""
_BOX = re.compile(rb"colrncl[cx](..)(..)", re.DOTALL)
_VP9 = re.compile(rb"vpcC.{4}...(.)(.)", re.DOTALL)
_PROFILE = re.compile(rb"colr(?:prof|rICC)")
_DOLBY = re.compile(rb"(?:dv[cvw]C|\x41\xe7\x84dv[cvw]C\x41\xed.)(.{5})", re.DOTALL)
"""Dolby Vision's record in a box, and in an element of Matroska."""
_SHOWN_AS_IT_IS = 2
"""Compatibility of the base layer with displays of SDR."""
_EBML, _CLUSTER = b"\x1a\x45\xdf\xa3", b"\x1f\x43\xb6\x75"
_ELEMENT = re.compile(rb"\x55\xb0(.{1,250})", re.DOTALL)
_PRIMARIES, _TRANSFER = rb"\x55\xbb", rb"\x55\xba"
_LARGEST = 1 << 26
"""Bytes of a file's tables that are looked through."""


def refuse_other_displays(video: Path) -> None:
    """InputError where a video is coded for displays of HDR or of wider colours, by any of what it states."""
    try:
        tables = _tables(video)
        for primaries, transfer in [*_container_colours(tables), *stream_colours(video)]:
            refuse_hdr(transfer, "colour information")
            if primaries not in _NARROW:
                raise InputError(f"has {name_of(primaries)} as the primaries of its colours")
        for record in _DOLBY.finditer(tables):
            if record[1][4] >> 4 != _SHOWN_AS_IT_IS:
                raise InputError("is HDR coded for Dolby Vision")
        if _PROFILE.search(tables):
            raise InputError("has an ICC profile, which is not read of videos")
    except InputError as error:
        raise InputError(
            f"{video} {str(error).partition(':')[0]}: export it as SDR (Rec. 709) first."
        ) from None


def _tables(video: Path) -> bytes:
    """Part of a file that describes its tracks: `moov` of MP4 and MOV, in Matroska all before pictures."""
    with video.open("rb") as file:
        if file.read(4) == _EBML:
            file.seek(0)
            return file.read(_LARGEST).partition(_CLUSTER)[0]
        file.seek(0)
        while len(head := file.read(8)) == 8:
            start, length = file.tell() - 8, int.from_bytes(head[:4])
            if head[4:] == b"moov":
                return file.read(min(length, _LARGEST))
            if length == 1:
                length = int.from_bytes(file.read(8))
            if length < 8:
                break
            file.seek(start + length)
    return b""


def _container_colours(tables: bytes) -> Iterator[Colours]:
    """Colours of the boxes `colr` (ISO/IEC 14496-12) and `vpcC`, and of the element `Colour` (RFC 9559)."""
    if tables[:4] != _EBML:
        for box in [*_BOX.finditer(tables), *_VP9.finditer(tables)]:
            yield int.from_bytes(box[1]), int.from_bytes(box[2])
        return
    match = _ELEMENT.search(tables)
    parts = b"" if match is None else match[1]
    said = (re.search(name + rb"\x81(.)", parts, re.DOTALL) for name in (_PRIMARIES, _TRANSFER))
    primaries, transfer = (
        usual if one is None else one[1][0] for one, usual in zip(said, UNSAID, strict=True)
    )
    yield primaries, transfer

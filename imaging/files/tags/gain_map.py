"""Gain maps: what a photograph holds beside its picture, by which displays of HDR make it brighter.

Android's Ultra HDR and Adobe's (namespace `hdrgm`), ISO 21496-1 (2025) and Apple's auxiliary picture. The
picture itself is whole without them, and its white is that of a print.
"""

import struct
from dataclasses import dataclass

ISO = b"urn:iso:std:iso:ts:21496:-1\0"
"""Prefix of a JPEG segment in which ISO 21496-1 states a gain map."""
_ADOBE = b"http://ns.adobe.com/hdr-gain-map/1.0/"
_MARKS = (_ADOBE, ISO[:-1], b"urn:com:apple:photo:2020:aux:hdrgainmap")
ASIDE = "HDR gain map is ignored: only the picture itself is read, and light above its white is unknown."
_BASE_COLOURS = 0x40
"""Flag of ISO 21496-1: the map is in the primaries of the picture."""
_PARTS = 1 << 16
"""Denominator of fractions."""
_PACKET = (
    '<?xpacket begin="" id="W5M0MpCehiHzreSzNTczkc9d"?>'
    '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
    '<rdf:Description rdf:about="" xmlns:hdrgm="{}" hdrgm:Version="1.0"{}</rdf:RDF></x:xmpmeta>'
    '<?xpacket end="r"?>'
)
_DIRECTORY = (
    ' xmlns:Container="http://ns.google.com/photos/1.0/container/"'
    ' xmlns:Item="http://ns.google.com/photos/1.0/container/item/"><Container:Directory><rdf:Seq>'
    '<rdf:li rdf:parseType="Resource">'
    '<Container:Item Item:Semantic="Primary" Item:Mime="image/jpeg"/></rdf:li>'
    '<rdf:li rdf:parseType="Resource">'
    '<Container:Item Item:Semantic="GainMap" Item:Mime="image/jpeg" Item:Length="{}"/></rdf:li>'
    "</rdf:Seq></Container:Directory></rdf:Description>"
)


@dataclass(frozen=True)
class GainRange:
    """Meaning of the codes, in all channels: light = (picture + offset) * 2^gain - offset.

    least, most: gain of the codes 0 and 255, stops, linear between them. offset: of light, 1 being white.
    headroom: stops above white of a screen that shows the map in full.
    """

    least: float
    most: float
    offset: float
    headroom: float


def holds_gain_map(data: bytes) -> bool:
    """Return whether the bytes of a JPEG or HEIF file hold a gain map."""
    brands = data[8 : min(int.from_bytes(data[:4]), 256)] if data[4:8] == b"ftyp" else b""
    return b"tmap" in brands or any(mark in data for mark in _MARKS)


def iso_body(stated: GainRange) -> bytes:
    """ISO 21496-1, annex C.2, behind the versions: one set of values for all channels, as fractions."""
    headroom, least, most, offset = (
        (round(value * _PARTS), _PARTS)
        for value in (stated.headroom, stated.least, stated.most, stated.offset)
    )
    values = (0, 1, *headroom, *least, *most, 1, 1, *offset, *offset)
    return struct.pack(">B IIII iIiI II iIiI", _BASE_COLOURS, *values)


def map_xmp(stated: GainRange) -> bytes:
    """XMP packet in the gain map: the same values, of which gains are stops."""
    values = {
        "GainMapMin": stated.least,
        "GainMapMax": stated.most,
        "Gamma": 1,
        "OffsetSDR": stated.offset,
        "OffsetHDR": stated.offset,
        "HDRCapacityMin": 0,
        "HDRCapacityMax": stated.headroom,
    }
    written = "".join(f' hdrgm:{name}="{value:.9g}"' for name, value in values.items())
    return _PACKET.format(_ADOBE.decode(), f'{written} hdrgm:BaseRenditionIsHDR="False"/>').encode()


def container_xmp(size: int) -> bytes:
    """XMP packet in the picture: a gain map of `size` bytes follows it (GContainer)."""
    return _PACKET.format(_ADOBE.decode(), _DIRECTORY.format(size)).encode()

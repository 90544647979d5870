"""Gain maps: what a photograph holds beside its picture, by which displays of HDR make it brighter.

Android's Ultra HDR and Adobe's (namespace `hdrgm`), ISO 21496-1 (2025) and Apple's auxiliary picture. The
picture itself is whole without them, and its white is that of a print.
"""

_MARKS = (
    b"http://ns.adobe.com/hdr-gain-map/1.0/",
    b"urn:iso:std:iso:ts:21496:-1",
    b"urn:com:apple:photo:2020:aux:hdrgainmap",
)
ASIDE = "HDR gain map is ignored: only the picture itself is read, and light above its white is unknown."


def holds_gain_map(data: bytes) -> bool:
    """Return whether the bytes of a JPEG or HEIF file hold a gain map."""
    brands = data[8 : min(int.from_bytes(data[:4]), 256)] if data[4:8] == b"ftyp" else b""
    return b"tmap" in brands or any(mark in data for mark in _MARKS)

"""Ultra HDR JPEG: a picture that every program shows, and a gain map that restores its light on HDR screens.

The gain map is a second JPEG in the same file (CIPA DC-007, Multi-Picture Format). What its codes mean is
stated twice: by ISO 21496-1 (2025), and in the XMP of Android's Ultra HDR 1.1 (namespace `hdrgm`, with the
directory of GContainer), the only one that Android 14 reads.
"""

import struct

import imagecodecs
import numpy as np

from imaging.arrays import Array32, Bytes
from imaging.colour.spaces import srgb_decode
from imaging.files.hdr_display import within
from imaging.files.photo import encode_jpeg
from imaging.files.tags.gain_map import ISO, GainRange, container_xmp, iso_body, map_xmp
from imaging.files.tags.xmp import MARK

_QUALITY = 98
"""At which light of the demo is within 0.05 stops in 95 % of its pixels."""
_OFFSET = 1 / 64
"""Added to light on both sides of the ratio, so that black has a gain."""
_LEAST_HEADROOM = 1.0
"""Stops: of a picture without light above white, whose two sides differ by rounding alone."""
_APP1, _APP2 = 0xE1, 0xE2
_INDEX = b"MPF\0"
_ISO_VERSION = bytes(4)
"""Least version of a reader, and version of the writer."""


def encode_ultra_hdr(light: Array32, base: Bytes) -> bytes:
    """Ultra HDR JPEG of linear Rec.709, 1 as white, beside which the picture for SDR screens is given.

    The gain map has the size of the picture, a channel of each of its own, and is made against the picture as
    JPEG has it, so that it also takes back the rounding of 8 bits.

    Args:
        light: [H, W, 3], clipped as `within` does.
        base: sRGB uint8 [H, W, 3], shown on screens without headroom.

    Returns:
        Bytes of the file.
    """
    shown = within(light)
    picture = encode_jpeg(base, _QUALITY)
    plain = srgb_decode(np.asarray(imagecodecs.jpeg8_decode(picture), np.float32) / 255)
    gain = np.log2((shown + _OFFSET) / (plain + _OFFSET))
    least, most = float(gain.min()), float(gain.max())
    most = max(most, least + 1 / 256)
    headroom = max(float(np.log2(max(shown.max(), 1))), _LEAST_HEADROOM)
    stated = GainRange(least, most, _OFFSET, headroom)
    codes = np.round(255 * (gain - least) / (most - least)).astype(np.uint8)
    second = _with_segments(
        encode_jpeg(codes, _QUALITY),
        (_APP1, MARK + map_xmp(stated)),
        (_APP2, ISO + _ISO_VERSION + iso_body(stated)),
    )
    before = (_APP1, MARK + container_xmp(len(second))), (_APP2, ISO + _ISO_VERSION)
    draft = _with_segments(picture, *before, (_APP2, _index(0, 0, 0)))
    offset = len(draft) - (draft.index(_INDEX) + len(_INDEX))  # as the standard counts, from behind the name
    return draft.replace(_index(0, 0, 0), _index(len(draft), len(second), offset)) + second


def _with_segments(jpeg: bytes, *segments: tuple[int, bytes]) -> bytes:
    """A JPEG with segments behind its first, that of JFIF."""
    place = 4 + int.from_bytes(jpeg[4:6])
    made = [struct.pack(">BBH", 0xFF, marker, len(body) + 2) + body for marker, body in segments]
    return jpeg[:place] + b"".join(made) + jpeg[place:]


def _index(first: int, second: int, offset: int) -> bytes:
    """The index of two pictures of `first` and `second` bytes, the second at `offset` from its header."""
    return _INDEX + struct.pack(
        ">2sHIH HHI4s HHII HHII I IIIHH IIIHH",
        *(b"MM", 42, 8, 3),
        *(0xB000, 7, 4, b"0100"),
        *(0xB001, 4, 1, 2),
        *(0xB002, 7, 32, 50),
        0,
        *(0x030000, first, 0, 0, 0),  # the baseline picture
        *(0, second, offset, 0, 0),
    )

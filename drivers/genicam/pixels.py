# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""The pixel formats of machine vision cameras, and exact unpacking of them to uint16.

Codes and bit layouts from the Pixel Format Naming Convention: "p" formats are one stream of bits, the
lowest first; "Packed" ones put the high bits of two pixels around a byte with the low bits of both.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from drivers.errors import CameraProtocol, CameraRefused
from imaging.arrays import Bytes
from imaging.compute.jit import compiled
from imaging.sensor.cfa import Cfa

Image = npt.NDArray[np.uint16]


@dataclass(frozen=True)
class PixelFormat:
    """A format. bits: of a value; cfa: the table from the frame's first pixel on.

    packing: values in bytes ("plain"), as a stream of bits ("p") or pair by pair ("Packed").
    """

    name: str
    code: int
    bits: int
    packing: Literal["plain", "p", "Packed"]
    cfa: Cfa

    @property
    def stored_bits(self) -> int:
        """Bits that a pixel takes in the payload."""
        return self.code >> 16 & 0xFF

    def row_bytes(self, width: int) -> int:
        """Bytes of that many pixels."""
        return -(-width * self.stored_bits // 8)


_CFAS = {"GR": Cfa.GRBG, "RG": Cfa.RGGB, "GB": Cfa.GBRG, "BG": Cfa.BGGR}
_TAILS: dict[tuple[int, Literal["plain", "p", "Packed"]], tuple[int, ...]] = {
    # By letters in the order of _CFAS.
    (8, "plain"): (0x01080008, 0x01080009, 0x0108000A, 0x0108000B),
    (10, "plain"): (0x0110000C, 0x0110000D, 0x0110000E, 0x0110000F),
    (12, "plain"): (0x01100010, 0x01100011, 0x01100012, 0x01100013),
    (16, "plain"): (0x0110002E, 0x0110002F, 0x01100030, 0x01100031),
    (10, "p"): (0x010A0056, 0x010A0058, 0x010A0054, 0x010A0052),
    (12, "p"): (0x010C0057, 0x010C0059, 0x010C0055, 0x010C0053),
    (10, "Packed"): (0x010C0026, 0x010C0027, 0x010C0028, 0x010C0029),
    (12, "Packed"): (0x010C002A, 0x010C002B, 0x010C002C, 0x010C002D),
}
FORMATS: tuple[PixelFormat, ...] = (
    *(
        PixelFormat(f"Bayer{letters}{bits}{'' if packing == 'plain' else packing}", code, bits, packing, cfa)
        for (bits, packing), codes in _TAILS.items()
        for (letters, cfa), code in zip(_CFAS.items(), codes, strict=True)
    ),
    PixelFormat("Mono8", 0x01080001, 8, "plain", Cfa.MONO),
    PixelFormat("Mono10", 0x01100003, 10, "plain", Cfa.MONO),
    PixelFormat("Mono12", 0x01100005, 12, "plain", Cfa.MONO),
    PixelFormat("Mono16", 0x01100007, 16, "plain", Cfa.MONO),
    PixelFormat("Mono10p", 0x010A0046, 10, "p", Cfa.MONO),
    PixelFormat("Mono12p", 0x010C0047, 12, "p", Cfa.MONO),
    PixelFormat("Mono10Packed", 0x010C0004, 10, "Packed", Cfa.MONO),
    PixelFormat("Mono12Packed", 0x010C0006, 12, "Packed", Cfa.MONO),
)
BY_CODE = {pixel_format.code: pixel_format for pixel_format in FORMATS}
BY_NAME = {pixel_format.name: pixel_format for pixel_format in FORMATS}


def format_of(code: int) -> PixelFormat:
    """The format with that code. CameraRefused if it is not one of ours."""
    try:
        return BY_CODE[code]
    except KeyError:
        raise CameraRefused(
            f"pixel format {code:#010x} cannot be unpacked: set the camera to a Bayer or Mono format."
        ) from None


def unpack(data: Bytes, pixels: PixelFormat, width: int, height: int, padding: int = 0) -> Image:
    """The values of a frame.

    Args:
        data: Bytes of the frame, uint8, which may be followed by others.
        pixels: Format of the pixels.
        width: Width of the frame, px.
        height: Height of the frame, px.
        padding: Bytes after each row. Without any, rows follow on from one another bit by bit, so that a row
            may begin inside a byte.

    Returns:
        The values, uint16 [height, width].

    Raises:
        CameraProtocol: There are too few bytes.
    """
    if padding == 0:
        needed, rows, count = pixels.row_bytes(width * height), 1, width * height
    else:
        needed, rows, count = height * (pixels.row_bytes(width) + padding) - padding, height, width
    if len(data) < needed:
        raise CameraProtocol(
            f"{len(data)} bytes are no {width}x{height} pixels of {pixels.name}, which are {needed}"
        )
    image = np.empty((rows, count), np.uint16)
    stride, used = pixels.row_bytes(count) + padding, pixels.row_bytes(count)
    for row in range(rows):
        _unpack_run(data[row * stride : row * stride + used], pixels, image[row])
    return image.reshape(height, width)


def _unpack_run(data: Bytes, pixels: PixelFormat, out: Image) -> None:
    """Pixels that follow on from one another."""
    if pixels.stored_bits == 8:
        out[:] = data
    elif pixels.packing == "plain":
        # As the array may begin at an odd address, its bytes are copied and not viewed.
        out.view(np.uint8)[:] = data
        if not np.little_endian:
            out.byteswap(inplace=True)
    else:
        _KERNELS[pixels.bits, pixels.packing](np.ascontiguousarray(data), out)


# The kernels count in whole groups, with all arithmetic in 16 bits: LLVM turns these loops into shuffles
# and shifts of whole vectors.


@compiled
def _twelve_p(data, out):
    """3 bytes are 2 pixels."""
    low, four, eight = np.uint16(15), np.uint16(4), np.uint16(8)
    for pair in range(out.size // 2):
        first, middle, last = (
            np.uint16(data[3 * pair]),
            np.uint16(data[3 * pair + 1]),
            np.uint16(data[3 * pair + 2]),
        )
        out[2 * pair] = first | (middle & low) << eight
        out[2 * pair + 1] = middle >> four | last << four
    if out.size % 2:
        at = out.size // 2 * 3
        out[out.size - 1] = np.uint16(data[at]) | (np.uint16(data[at + 1]) & low) << eight


@compiled
def _twelve_packed(data, out):
    """3 bytes are 2 pixels."""
    low, four = np.uint16(15), np.uint16(4)
    for pair in range(out.size // 2):
        first, middle, last = (
            np.uint16(data[3 * pair]),
            np.uint16(data[3 * pair + 1]),
            np.uint16(data[3 * pair + 2]),
        )
        out[2 * pair] = first << four | middle & low
        out[2 * pair + 1] = last << four | middle >> four
    if out.size % 2:
        at = out.size // 2 * 3
        out[out.size - 1] = np.uint16(data[at]) << four | np.uint16(data[at + 1]) & low


@compiled
def _ten_packed(data, out):
    """3 bytes are 2 pixels, with 4 bits unused."""
    low, two, four = np.uint16(3), np.uint16(2), np.uint16(4)
    for pair in range(out.size // 2):
        first, middle, last = (
            np.uint16(data[3 * pair]),
            np.uint16(data[3 * pair + 1]),
            np.uint16(data[3 * pair + 2]),
        )
        out[2 * pair] = first << two | middle & low
        out[2 * pair + 1] = last << two | (middle >> four) & low
    if out.size % 2:
        at = out.size // 2 * 3
        out[out.size - 1] = np.uint16(data[at]) << two | np.uint16(data[at + 1]) & low


@compiled
def _ten_p(data, out):
    """5 bytes are 4 pixels."""
    two, four, six, eight = np.uint16(2), np.uint16(4), np.uint16(6), np.uint16(8)
    groups = out.size // 4
    for group in range(groups):
        a = np.uint16(data[5 * group])
        b = np.uint16(data[5 * group + 1])
        c = np.uint16(data[5 * group + 2])
        d = np.uint16(data[5 * group + 3])
        e = np.uint16(data[5 * group + 4])
        out[4 * group] = a | (b & np.uint16(3)) << eight
        out[4 * group + 1] = b >> two | (c & np.uint16(15)) << six
        out[4 * group + 2] = c >> four | (d & np.uint16(63)) << four
        out[4 * group + 3] = d >> six | e << two
    for pixel in range(4 * groups, out.size):
        at = 10 * pixel // 8
        shift = np.uint16(10 * pixel % 8)
        value = np.uint16(data[at]) | np.uint16(data[at + 1]) << eight
        out[pixel] = (value >> shift) & np.uint16(1023)


_KERNELS = {
    (12, "p"): _twelve_p,
    (12, "Packed"): _twelve_packed,
    (10, "p"): _ten_p,
    (10, "Packed"): _ten_packed,
}

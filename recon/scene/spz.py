"""SPZ, the packed splats of Niantic: fixed-point places, 8 bits for what else there is, compressed.

Colours reach from -0.44 to 1.44, display values and a bit beyond; linear light does not fit in. Axes are
those of OpenGL, x right, y up, z back, where PLY files of 3DGS have x right, y down, z ahead; y and z change
their signs. Version 3 is in gzip, version 4 has the same numbers in streams of Zstandard; versions 2 to 4 are
read. https://github.com/nianticlabs/spz
"""

import gzip
import math
import struct
import zlib
from itertools import pairwise
from pathlib import Path
from typing import Literal

import imagecodecs
import numpy as np

from imaging.arrays import Array, Bytes
from imaging.errors import InputError
from recon.scene.ply_file import PlySplats

BRIGHTEST = 0.5 + 0.5 / 0.15 * 0.28209479177387814
"""Largest value of a colour."""
Version = Literal[3, 4]
"""Versions that are written."""
_MAGIC = 0x5053474E
_COLOUR = 0.15
_ODD = ("y", "z", "x", "xy", "yz", "", "xz", "", "y", "xyz", "y", "z", "x", "z", "x")
_PARITY = np.array([[int(axis in odd) for axis in "xyz"] for odd in _ODD])
"""Axes with which the harmonics of degree 1 to 3 change their sign, [15, 3]."""
ANTIALIASED, EXTENDED = 1, 2
"""Flags: trained with the 2D filter of Mip-Splatting, and with records of makers."""
BLUR = 0.3
"""Variance, px^2, of that filter, as gsplat and viewers have it."""
_COORDINATES = 0xADBE0003
"""Adobe's record of the axes in which numbers are stored, where they are not those of OpenGL."""
_OPENGL = 4
_LEVEL = 8
"""Largest number of axes that differ from those of PLY by signs; bits of it less 1: right, up, ahead."""
_MOST_BITS = 23
_LARGEST = 2**9 - 1
_HEADER = 32
"""Bytes of the header of version 4, behind which the records are."""
_EFFORT = 12
"""Level of Zstandard, as Niantic's own program has it."""
_MOST = 100_000_000
"""Gaussians that a file is believed to have."""


def pack(
    means: Array, log_scales: Array, quats: Array, opacities: Array, harmonics: Array, version: Version = 3
) -> bytes:
    """A file of Gaussians as `PlySplats` has them, but with opacities in 0..1 and quats of length 1.

    Args:
        means: Places [N, 3], in the axes of PLY files.
        log_scales: Natural logarithms of the standard deviations, [N, 3].
        quats: Rotations [N, 4], wxyz, of length 1.
        opacities: Opacities [N], within 0..1.
        harmonics: Coefficients [N, (degree + 1)^2, 3], up to degree 3.
        version: Version of the format: 3 in gzip, 4 in streams of Zstandard.

    Returns:
        The bytes of the file.
    """
    degree = math.isqrt(harmonics.shape[1]) - 1
    flips, flips_quat, flips_rest = _signs(_OPENGL)
    reach = max(float(np.abs(means).max(initial=0)), 1e-12)
    bits = int(np.clip(math.floor(math.log2((2**23 - 1) / reach)), 0, _MOST_BITS))
    fixed = np.round(means * flips * 2**bits).clip(1 - 2**23, 2**23 - 1).astype("<i4")
    places = fixed.view(np.uint8).reshape(len(means), 3, 4)[..., :3]
    parts = [
        places,
        _byte(255 * opacities),
        _byte(255 * (harmonics[:, 0] * _COLOUR + 0.5)),
        _byte(16 * (log_scales + 10)),
        _packed_quats(quats * flips_quat),
        _byte(128 * harmonics[:, 1:] * flips_rest[: harmonics.shape[1] - 1, None] + 128),
    ]
    streams = [part.tobytes() for part in parts if part.size]
    fields = _MAGIC, version, len(means), degree, bits, 0
    if version == 3:
        return gzip.compress(struct.pack("<IIIBBBB", *fields, 0) + b"".join(streams), mtime=0)
    packed = [imagecodecs.zstd_encode(stream, level=_EFFORT) for stream in streams]
    header = struct.pack("<IIIBBBBI12x", *fields, len(streams), _HEADER)
    sizes = [size for pair in zip(map(len, packed), map(len, streams), strict=True) for size in pair]
    return b"".join([header, struct.pack(f"<{len(sizes)}Q", *sizes), *packed])


def read_spz(path: Path) -> PlySplats:
    """Read the Gaussians of a file of any program; InputError if it is damaged or no SPZ."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}): correct the path.") from error
    try:
        return unpack(data)
    except (ValueError, EOFError, OSError, struct.error, zlib.error, imagecodecs.ZstdError) as error:
        raise InputError(f"{path} is not an SPZ file, or it is damaged ({error}): copy it again.") from error


def unpack(data: bytes) -> PlySplats:
    """Unpack the Gaussians in the bytes of a file; ValueError, or an error of the compression, for invalid
    bytes.
    """
    if data[:4] == struct.pack("<I", _MAGIC):
        version, count, degree, bits, flags, records, parts = _streams(data)
    else:
        plain = gzip.decompress(data)
        magic, version, count, degree, bits, flags, _ = struct.unpack("<IIIBBBB", plain[:16])
        if magic != _MAGIC or not 2 <= version <= 3:
            raise ValueError(f"version {version} of {magic:#x}")
        sizes = _sizes(version, count, degree)
        if len(plain) < 16 + sum(sizes):
            raise ValueError("it ends too early")
        ends = np.cumsum([16, *sizes])
        parts = [np.frombuffer(plain[a:b], np.uint8) for a, b in pairwise(ends)]
        records = plain[ends[-1] :]
    if count > _MOST or degree > 3 or bits > _MOST_BITS:
        raise ValueError(f"{count} Gaussians of degree {degree}")
    flips, flips_quat, flips_rest = _signs(_axes(records) if flags & EXTENDED else _OPENGL)
    if [len(part) for part in parts] != _sizes(version, count, degree):
        raise ValueError("its streams have other sizes")
    places, alphas, colours, scales, quats, rest = parts
    fixed = np.zeros((count * 3, 4), np.uint8)
    fixed[:, 1:] = places.reshape(-1, 3)
    means = (fixed.view("<i4")[:, 0] >> 8).reshape(count, 3) / 2.0**bits * flips
    opacities = (alphas / 255.0).clip(1e-6, 1 - 1e-6)
    constant = (colours.reshape(count, 1, 3) / 255.0 - 0.5) / _COLOUR
    others = (rest.reshape(count, -1, 3) - 128.0) / 128
    others = others * flips_rest[: others.shape[1], None]
    return PlySplats(
        means=means,
        log_scales=scales.reshape(count, 3) / 16.0 - 10,
        quats=(_unpacked_quats(quats) if version > 2 else _older_quats(quats)) * flips_quat,
        logits=np.log(opacities / (1 - opacities)),
        harmonics=np.concatenate([constant, others], axis=1),
        comments=(),
        made_up=BLUR if flags & ANTIALIASED else None,
    )


def _signs(axes: int) -> tuple[Array, Array, Array]:
    """Signs of places, rotations (wxyz) and harmonics by which numbers in such axes become those of PLY."""
    right, up, ahead = (bool(axes - 1 >> bit & 1) for bit in range(3))
    signs = np.array([1 if right else -1, -1 if up else 1, 1 if ahead else -1])
    x, y, z = signs
    return signs, np.array([1, y * z, x * z, x * y]), np.prod(signs**_PARITY, axis=1)


def _axes(records: bytes) -> int:
    """Number of the axes by Adobe's record, else that of OpenGL's; ValueError for axes in another order."""
    place = 0
    while place + 8 <= len(records):
        kind, length = struct.unpack_from("<II", records, place)
        if kind == _COORDINATES and length == 4 and place + 12 <= len(records):
            axes = int(struct.unpack_from("<I", records, place + 8)[0])
            if axes > _LEVEL:
                raise ValueError(f"its axes, number {axes} of Adobe's extension, are not read")
            return axes or _OPENGL
        place += 8 + length
    return _OPENGL


def _sizes(version: int, count: int, degree: int) -> list[int]:
    """Bytes of places, opacities, colours, sizes, turns and harmonics."""
    return [9 * count, count, 3 * count, 3 * count, (4 if version > 2 else 3) * count,
            3 * ((degree + 1) ** 2 - 1) * count]  # fmt: skip


def _streams(data: bytes) -> tuple[int, int, int, int, int, bytes, list[Bytes]]:
    """Version, number of Gaussians, degree, bits of the fraction, flags, records and streams of version 4."""
    _, version, count, degree, bits, flags, streams, table = struct.unpack("<IIIBBBBI", data[:20])
    if version != 4 or count > _MOST or degree > 3:
        raise ValueError(f"version {version}, {count} Gaussians of degree {degree}")
    sizes = _sizes(version, count, degree)
    entries = struct.unpack(f"<{2 * streams}Q", data[table : table + 16 * streams])
    place = table + 16 * streams
    parts: list[Bytes] = []
    for packed, plain in zip(entries[::2], entries[1::2], strict=True):
        if len(parts) == len(sizes) or plain != sizes[len(parts)]:
            raise ValueError("its streams have other sizes")
        piece = imagecodecs.zstd_decode(data[place : place + packed], out=plain) if plain else b""
        parts.append(np.frombuffer(piece, np.uint8))
        place += packed
    parts += [np.empty(0, np.uint8)] * (len(sizes) - len(parts))
    return version, count, degree, bits, flags, data[_HEADER:table], parts


def _packed_quats(quats: Array) -> Bytes:
    """The three smaller parts of [N, 4], wxyz, 10 bits each, and which the largest is of xyzw: [N, 4]."""
    xyzw = quats[:, [1, 2, 3, 0]]
    largest = np.abs(xyzw).argmax(axis=1)
    turned = np.where(np.take_along_axis(xyzw, largest[:, None], 1) < 0, -xyzw, xyzw)
    word = largest.astype(np.uint32)
    for part in range(4):
        value = np.floor(_LARGEST * np.abs(turned[:, part]) * math.sqrt(2) + 0.5).clip(0, _LARGEST)
        code = (turned[:, part] < 0).astype(np.uint32) << 9 | value.astype(np.uint32)
        word = np.where(part == largest, word, word << 10 | code).astype("<u4")
    return np.ascontiguousarray(word, "<u4").view(np.uint8).reshape(-1, 4)


def _unpacked_quats(codes: Bytes) -> Array:
    word = codes.view("<u4").astype(np.int64)
    largest = word >> 30
    xyzw = np.zeros((len(word), 4))
    for part in (3, 2, 1, 0):
        here = part != largest
        value = (word & _LARGEST) / (_LARGEST * math.sqrt(2)) * np.where(word >> 9 & 1, -1, 1)
        xyzw[:, part] = np.where(here, value, 0)
        word = np.where(here, word >> 10, word)
    rows = np.arange(len(word))
    xyzw[rows, largest] = np.sqrt(np.maximum(0, 1 - np.square(xyzw).sum(1)))
    return xyzw[:, [3, 0, 1, 2]]


def _older_quats(codes: Bytes) -> Array:
    """Quaternions of version 2: x, y and z in 8 bits, w by the unit norm."""
    xyz = codes.reshape(-1, 3) / 127.5 - 1
    return np.column_stack([np.sqrt(np.maximum(0, 1 - np.square(xyz).sum(1))), xyz])


def _byte(values: Array) -> Bytes:
    return np.asarray(np.round(values).clip(0, 255), np.uint8)

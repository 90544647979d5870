"""DNG files: a Bayer mosaic with everything that is needed to read it as linear light.

Written here and not by a library: the tested ones write no EXIF directory, or strips and tiles at
once, or lossless JPEG that LibRaw decodes to wrong pixels. DNG 1.4, little-endian, one image.
"""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Literal

import imagecodecs
import numpy as np
import numpy.typing as npt

from imaging import store
from imaging.exif import CAMERA_SERIAL, camera_entries, exif_entries
from imaging.mosaic import RawMosaic
from imaging.tiff import (
    ASCII,
    BYTE,
    DOUBLE,
    EXIF_IFD,
    LONG,
    RATIONAL,
    SHORT,
    SRATIONAL,
    Entry,
    encode_directory,
    rational,
)

Compression = Literal["none", "ljpeg"]

_TILE = 256
"""Largest side of a lossless JPEG tile, px."""


def write_dng(path: Path, raw: RawMosaic, *, compression: Compression = "none") -> None:
    """Write a mosaic, whole or not at all; StorageError when the disk refuses, ValueError as `encode_dng`."""
    store.write_bytes(path, encode_dng(raw, compression))


def encode_dng(raw: RawMosaic, compression: Compression = "none") -> bytes:
    """The bytes of a DNG file. The same mosaic gives the same bytes.

    ValueError if the mosaic cannot be written: empty, not uint16 [H, W], white not in 1..65535 or
    a black level that is negative or not below white.
    """
    _check(raw)
    if min(raw.pixels.shape) < 16:
        compression = "none"  # LibRaw and dcraw decode a tile wider than the image to wrong pixels
    segments = list(_tiles(raw.pixels)) if compression == "ljpeg" else [raw.pixels.astype("<u2").tobytes()]
    main = {**camera_entries(raw.metadata), **_colour(raw), **_layout(raw, compression)}
    main[EXIF_IFD] = Entry(LONG, [0])
    place, size = (324, 325) if compression == "ljpeg" else (273, 279)
    lengths = [len(segment) for segment in segments]
    main[place], main[size] = Entry(LONG, [0] * len(segments)), Entry(LONG, lengths)

    exif_at = 8 + len(encode_directory(main, 8))
    exif = encode_directory(exif_entries(raw.metadata), exif_at)
    offset = exif_at + len(exif)
    starts = []
    for length in lengths:
        starts.append(offset)
        offset += length + length % 2
    main[EXIF_IFD], main[place] = Entry(LONG, [exif_at]), Entry(LONG, starts)
    padded = [segment + b"\0" * (len(segment) % 2) for segment in segments]
    return b"".join([b"II*\0", struct.pack("<I", 8), encode_directory(main, 8), exif, *padded])


def _check(raw: RawMosaic) -> None:
    if raw.pixels.dtype != np.uint16 or raw.pixels.ndim != 2 or 0 in raw.pixels.shape:
        raise ValueError(f"a mosaic is uint16 [H, W], not {raw.pixels.dtype} {raw.pixels.shape}")
    if not 1 <= raw.white <= 65535:
        raise ValueError(f"white level {raw.white} is not in 1..65535")
    if not all(0 <= black < raw.white for black in raw.black):
        raise ValueError(f"black levels {raw.black} are not between 0 and white {raw.white}")


def _tile_side(length: int) -> int:
    """A multiple of 16, as TIFF wants it, not above `length`, with little to spare at the edge."""
    even = -(-length // -(-length // _TILE) // 16) * 16
    return even if even <= length else length // 16 * 16


def _tiles(pixels: npt.NDArray[np.uint16]) -> Iterator[bytes]:
    """Lossless JPEG of each tile, row by row; edge tiles repeat the last pixels."""
    height, width = (_tile_side(length) for length in pixels.shape)
    padded = np.pad(pixels, ((0, -pixels.shape[0] % height), (0, -pixels.shape[1] % width)), mode="edge")
    for top in range(0, padded.shape[0], height):
        for left in range(0, padded.shape[1], width):
            tile = np.ascontiguousarray(padded[top : top + height, left : left + width])
            yield bytes(imagecodecs.ljpeg_encode(tile, bitspersample=16))


def _layout(raw: RawMosaic, compression: Compression) -> dict[int, Entry]:
    height, width = raw.pixels.shape
    entries = {
        254: Entry(LONG, [0]),  # NewSubfileType: the main image
        256: Entry(LONG, [width]),
        257: Entry(LONG, [height]),
        258: Entry(SHORT, [16]),  # BitsPerSample
        259: Entry(SHORT, [7 if compression == "ljpeg" else 1]),
        262: Entry(SHORT, [32803]),  # PhotometricInterpretation: CFA
        277: Entry(SHORT, [1]),  # SamplesPerPixel
        284: Entry(SHORT, [1]),  # PlanarConfiguration
        33421: Entry(SHORT, [2, 2]),  # CFARepeatPatternDim
        33422: Entry(BYTE, raw.cfa.pattern.reshape(-1).tolist()),
        50710: Entry(BYTE, [0, 1, 2]),  # CFAPlaneColor
        50711: Entry(SHORT, [1]),  # CFALayout: square
    }
    if compression == "ljpeg":
        return {**entries, 322: Entry(LONG, [_tile_side(width)]), 323: Entry(LONG, [_tile_side(height)])}
    return {**entries, 278: Entry(LONG, [height])}  # RowsPerStrip


def _colour(raw: RawMosaic) -> dict[int, Entry]:
    meta = raw.metadata
    entries = {
        50706: Entry(BYTE, [1, 4, 0, 0]),  # DNGVersion
        50707: Entry(BYTE, [1, 4, 0, 0]),  # DNGBackwardVersion
        50708: Entry(ASCII, f"{meta.make} {meta.model}".strip() or "hdr-rig"),  # UniqueCameraModel
        50713: Entry(SHORT, [2, 2]),  # BlackLevelRepeatDim
        50714: Entry(RATIONAL, [rational(black) for black in raw.black]),
        50717: Entry(LONG, [raw.white]),
    }
    if meta.serial:
        entries[CAMERA_SERIAL] = Entry(ASCII, meta.serial)
    if raw.camera_from_xyz is not None:
        matrix = [rational(value, signed=True) for row in raw.camera_from_xyz for value in row]
        entries[50721] = Entry(SRATIONAL, matrix)  # ColorMatrix1
        entries[50778] = Entry(SHORT, [21])  # CalibrationIlluminant1: D65
    if raw.neutral is not None:
        entries[50728] = Entry(RATIONAL, [rational(value) for value in raw.neutral])  # AsShotNeutral
    if raw.noise_profile is not None:
        entries[51041] = Entry(DOUBLE, list(raw.noise_profile))
    return entries

"""DNG files: a mosaic of any table, or mono, with everything that is needed to read it as linear light.

Written here and not by a library: the tested ones write no EXIF directory, or strips and tiles at
once, or lossless JPEG that LibRaw decodes to wrong pixels. DNG 1.4, little-endian, one image.
"""

import hashlib
import struct
from collections.abc import Iterator
from pathlib import Path

import imagecodecs
import numpy as np
import numpy.typing as npt

from imaging.arguments import checked
from imaging.choices import Compression
from imaging.files import store
from imaging.files.tiff import dng_tags as tag
from imaging.files.tiff.directory import (
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
from imaging.files.tiff.exif import CAMERA_SERIAL, camera_entries, exif_entries
from imaging.sensor.mosaic import RawMosaic

_TILE = 256
"""Largest side of a lossless JPEG tile, px."""

_TILE_STEP = 16
"""TIFF wants tile sides that are multiples of it."""

_IDENTIFYING = 16
"""Stride of the rows that enter the identity of the mosaic."""

_SMALLEST_SIDE = 22
"""LibRaw takes smaller images for no image."""


@checked
def write_dng(path: str | Path, raw: RawMosaic, *, compression: Compression = "none") -> None:
    """Write a mosaic as DNG, whole or not at all.

    Args:
        path: File.
        raw: Mosaic, uint16 [H, W].
        compression: 'ljpeg' halves the size and takes longer.

    Raises:
        StorageError: The disk refuses.
        ValueError: The mosaic cannot be written: not uint16 [H, W], a side below 22 px, white not in
            1..65535, a black level negative or not below white, or a non-finite number.
    """
    path = Path(path)
    store.write_bytes(path, encode_dng(raw, compression))


def encode_dng(raw: RawMosaic, compression: Compression = "none") -> bytes:
    """The bytes of a DNG file; the same mosaic gives the same bytes. See `dng_pieces`."""
    return b"".join(dng_pieces(raw, compression))


def dng_pieces(raw: RawMosaic, compression: Compression = "none") -> list[bytes | memoryview]:
    """The bytes of a DNG file one after another; those of uncompressed pixels are the mosaic's own.

    'ljpeg' halves the size and takes longer. ValueError if the mosaic cannot be written: not
    uint16 [H, W], a side below 22 px, white not in 1..65535, a black level negative or not below
    white, a number that is no number.
    """
    _check(raw)
    tiled = compression == "ljpeg" and raw.cfa is not None
    segments: list[bytes | memoryview]
    segments = list(_tiles(raw.pixels)) if tiled else [_as_stored(raw.pixels).data.cast("B")]
    lengths = [len(segment) for segment in segments]
    places, sizes = (tag.TILE_OFFSETS, tag.TILE_SIZES) if tiled else (tag.STRIP_OFFSETS, tag.STRIP_SIZES)
    # the lengths of all directories are known before the offsets in them are
    main = {**camera_entries(raw.metadata), **_layout(raw, tiled), **_geometry(raw), **_colour(raw)}
    main |= {EXIF_IFD: Entry(LONG, [0]), places: Entry(LONG, lengths), sizes: Entry(LONG, lengths)}
    exif_at = 8 + len(encode_directory(main, 8))
    exif = encode_directory(exif_entries(raw.metadata), exif_at)
    padded = [piece for segment in segments for piece in (segment, b"\0" * (len(segment) % 2))]
    first = exif_at + len(exif)
    ends = np.cumsum([0, *(length + length % 2 for length in lengths[:-1])])
    starts = [first + end for end in ends.tolist()]
    main |= {EXIF_IFD: Entry(LONG, [exif_at]), places: Entry(LONG, starts)}
    return [b"II*\0", struct.pack("<I", 8), encode_directory(main, 8), exif, *padded]


def _as_stored(pixels: npt.NDArray[np.uint16]) -> npt.NDArray[np.uint16]:
    """Little-endian and row by row; no copy if they are that already."""
    return np.ascontiguousarray(pixels, "<u2")


def _check(raw: RawMosaic) -> None:
    if raw.pixels.dtype != np.uint16 or raw.pixels.shape[2:] != (() if raw.cfa else (3,)):
        raise ValueError(
            f"a mosaic is uint16 [H, W] with a CFA, or light [H, W, 3], not {raw.pixels.dtype} "
            f"{raw.pixels.shape}"
        )
    if min(raw.pixels.shape[:2]) < _SMALLEST_SIDE:
        raise ValueError(f"a RAW file has {_SMALLEST_SIDE} pixels or more a side, not {raw.pixels.shape}")
    if raw.black_offset is not None:
        raise ValueError("black that varies from photosite to photosite is not written")
    if not 1 <= raw.white <= 65535:
        raise ValueError(f"white level {raw.white} is not in 1..65535")
    if not all(0 <= black < raw.white for row in raw.black for black in row):
        raise ValueError(f"black levels {raw.black} are not between 0 and white {raw.white}")


def _tile_side(length: int) -> int:
    """A multiple of 16 that is not above `length`, with little to spare at the edge.

    LibRaw and dcraw decode a tile that is wider than the image to wrong pixels.
    """
    side = -(-length // -(-length // _TILE) // _TILE_STEP) * _TILE_STEP
    return side if side <= length else length // _TILE_STEP * _TILE_STEP


def _tiles(pixels: npt.NDArray[np.uint16]) -> Iterator[bytes]:
    """Lossless JPEG of each tile, row by row; edge tiles repeat the last pixels.

    Two rows of a tile are coded as one, so that the predictor finds its own colour in the row
    above; the DNG specification (Compression) leaves the inner shape free.
    """
    height, width = (_tile_side(length) for length in pixels.shape)
    padded = np.pad(pixels, ((0, -pixels.shape[0] % height), (0, -pixels.shape[1] % width)), mode="edge")
    for top in range(0, padded.shape[0], height):
        for left in range(0, padded.shape[1], width):
            tile = padded[top : top + height, left : left + width].reshape(height // 2, 2 * width)
            yield bytes(imagecodecs.ljpeg_encode(np.ascontiguousarray(tile), bitspersample=16))


def _layout(raw: RawMosaic, tiled: bool) -> dict[int, Entry]:
    """Return how the pixels lie in the file: strips or tiles, never the tags of both."""
    height, width = raw.pixels.shape[:2]
    samples = 3 if raw.cfa is None else 1
    linear = raw.cfa is None or raw.cfa.mono
    entries = {
        tag.SUBFILE_TYPE: Entry(LONG, [0]),  # the full image
        tag.WIDTH: Entry(LONG, [width]),
        tag.HEIGHT: Entry(LONG, [height]),
        tag.BITS: Entry(SHORT, [16] * samples),
        tag.COMPRESSION: Entry(SHORT, [tag.LOSSLESS_JPEG if tiled else 1]),
        tag.PHOTOMETRIC: Entry(SHORT, [tag.LINEAR_PHOTOMETRIC if linear else tag.CFA_PHOTOMETRIC]),
        tag.SAMPLES: Entry(SHORT, [samples]),
        tag.PLANAR: Entry(SHORT, [1]),
    }
    if tiled:
        entries[tag.TILE_WIDTH] = Entry(LONG, [_tile_side(width)])
        entries[tag.TILE_HEIGHT] = Entry(LONG, [_tile_side(height)])
    else:
        entries[tag.ROWS_PER_STRIP] = Entry(LONG, [height])
    return entries


def _geometry(raw: RawMosaic) -> dict[int, Entry]:
    """Return which photosites there are, and that all of them count."""
    height, width = raw.pixels.shape[:2]
    codes = {letter: code for code, letter in tag.COLOUR_CODES.items()}
    filters: dict[int, Entry] = {}
    if raw.cfa is not None and not raw.cfa.mono:
        filters = {
            tag.CFA_REPEAT: Entry(SHORT, list(raw.cfa.period)),
            tag.CFA_PATTERN: Entry(BYTE, [codes[letter] for row in raw.cfa.rows for letter in row]),
            tag.CFA_PLANES: Entry(BYTE, [codes[letter] for letter in raw.cfa.letters]),
            tag.CFA_LAYOUT: Entry(SHORT, [1]),  # square
        }
    return {
        **filters,
        tag.DEFAULT_SCALE: Entry(RATIONAL, [1, 1]),
        tag.CROP_ORIGIN: Entry(LONG, [0, 0]),
        tag.CROP_SIZE: Entry(LONG, [width, height]),
        tag.ACTIVE_AREA: Entry(LONG, [0, 0, height, width]),
    }


def _colour(raw: RawMosaic) -> dict[int, Entry]:
    """Return what the numbers mean: levels, colour and noise."""
    meta = raw.metadata
    # Noise distinguishes mosaics by some rows as well as by all; a hash of all took longer than the disk.
    samples = 3 if raw.cfa is None else 1
    identity = hashlib.md5(_as_stored(raw.pixels[::_IDENTIFYING]).data, usedforsecurity=False)
    entries = {
        tag.SOFTWARE: Entry(ASCII, "hdr-rig"),
        tag.DNG_VERSION: Entry(BYTE, [1, 4, 0, 0]),
        tag.DNG_BACKWARD: Entry(BYTE, [1, 4, 0, 0]),
        tag.UNIQUE_MODEL: Entry(ASCII, f"{meta.make} {meta.model}".strip() or "hdr-rig"),
        tag.RAW_UNIQUE_ID: Entry(BYTE, identity.digest()),
        tag.BLACK_REPEAT: Entry(SHORT, [len(raw.black), len(raw.black[0])]),
        tag.BLACK: Entry(RATIONAL, [rational(black) for row in raw.black for black in row] * samples),
        tag.WHITE: Entry(LONG, [raw.white] * samples),
        tag.BASELINE_EXPOSURE: Entry(SRATIONAL, [0]),
        tag.BASELINE_NOISE: Entry(RATIONAL, [1]),
        tag.BASELINE_SHARPNESS: Entry(RATIONAL, [1]),
        tag.LINEAR_LIMIT: Entry(RATIONAL, [1]),
    }
    if meta.serial:
        entries[CAMERA_SERIAL] = Entry(ASCII, meta.serial)
    if raw.camera_from_xyz is not None:
        matrix = [rational(value, signed=True) for row in raw.camera_from_xyz for value in row]
        entries[tag.MATRIX_1] = Entry(SRATIONAL, matrix)
        entries[tag.ILLUMINANT_1] = Entry(SHORT, [tag.D65])
    if raw.neutral is not None:
        entries[tag.NEUTRAL] = Entry(RATIONAL, [rational(value) for value in raw.neutral])
    if raw.noise_profile is not None:
        shares = raw.noise_shares or (1.0,)
        pairs = [share * value for share in shares for value in raw.noise_profile]
        entries[tag.NOISE_PROFILE] = Entry(DOUBLE, pairs)
    return entries

"""RAW files of any make, read as a mosaic of any colour filter array, mono, or light that was demosaicked.

LibRaw (rawpy) decodes the pixels. What a DNG says in its tags is read from the tags themselves,
because LibRaw rounds black levels and keeps neither ColorMatrix1 nor NoiseProfile; and so are the pixels of
DNG files whose photosites lie otherwise than Bayer's, most of which LibRaw takes for Bayer.
"""

from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import BinaryIO

import numpy as np
import numpy.typing as npt
import rawpy

from imaging.arguments import checked
from imaging.compute.memory import check_picture
from imaging.errors import InputError
from imaging.files.raw_rows import row_stops
from imaging.files.silence import quiet
from imaging.files.tags.raw_exif import spoken
from imaging.files.tiff import dng_colour, dng_tags, dng_unread
from imaging.files.tiff.directory import Directory, TiffError, TiffReader
from imaging.files.tiff.dng_pixels import is_foreign, read_pixels
from imaging.files.tiff.exif import read_exif
from imaging.sensor.cfa import Cfa, as_tile
from imaging.sensor.mosaic import FrameMetadata, RawMosaic, as_matrix

_MAKERS = (
    "3fr arw cr2 cr3 crw dcr dng erf fff iiq kdc mef mos mrw nef nrw orf pef raf raw rw2 rwl sr2 srf srw x3f"
)
TABLE = 12
"""Rows and columns of photosites that a table is read from: twice what X-Trans repeats after."""
SUFFIXES = frozenset(f".{name}" for name in _MAKERS.split())


def is_raw(path: Path) -> bool:
    """Return whether the suffix is one of a RAW file."""
    return path.suffix.lower() in SUFFIXES


@checked
def read_raw(path: str | Path) -> RawMosaic:
    """Read the mosaic of a RAW file, cut to its active area.

    Orientation is not applied. Black, white, colour and noise are those that the file states: real clipping
    may lie below its white level.

    Args:
        path: File of a camera, or DNG.

    Returns:
        The mosaic in DN, uint16 [H, W], with levels, colour, noise and metadata.

    Raises:
        InputError: The file is damaged or no RAW, or a DNG with tags that change its samples (`dng_unread`);
            the sentence names the tag.
    """
    path = Path(path)
    tags, metadata = _read_tags(path)
    unread = "" if tags is None else dng_unread.reason(tags)
    if unread:
        raise InputError(f"{path} {unread}.")
    developed = tags is not None and dng_tags.is_developed(tags)
    cfa = None if tags is None or developed else _cfa(path, tags)
    try:
        if tags is not None and developed:
            mosaic = _of_linear_dng(path, tags)
        elif tags is not None and cfa is not None and (not cfa.bayer or is_foreign(tags)):
            mosaic = _of_dng(path, tags, cfa)
        else:
            with quiet(), rawpy.imread(str(path)) as raw:
                decoded, corner = _decoded(path, raw, tags), (raw.sizes.top_margin, raw.sizes.left_margin)
                mosaic = decoded if tags is None else _with_tags(decoded, tags, corner)
                if metadata is None:
                    with path.open("rb") as file:
                        metadata = spoken(file, raw)
    except InputError:
        raise
    except Exception as error:  # rawpy raises whatever damaged bytes make it trip over
        raise _undecodable(path, tags) from error
    metadata = metadata or FrameMetadata()
    return _checked(path, replace(mosaic, metadata=metadata))


def decode_raw(data: bytes, suffix: str) -> RawMosaic:
    """The mosaic in the bytes of a RAW file whose name ends in `suffix`; InputError as `read_raw`."""
    with TemporaryDirectory(prefix="rig-") as folder:
        path = Path(folder) / f"picture{suffix}"
        path.write_bytes(data)
        return read_raw(path)


@dataclass(frozen=True)
class RawHeader:
    """Header of a RAW file. white: its largest code, as far as the header states it."""

    width: int
    height: int
    white: int
    metadata: FrameMetadata


def read_raw_header(data: bytes, suffix: str) -> RawHeader:
    """The header in the bytes of a RAW file, none of whose pixels is decoded.

    InputError as `read_raw`, also where the file is seen to be cut off; damage among the pixels is not.
    """
    path = Path(f"picture{suffix}")
    tags, metadata = _tags(path, BytesIO(data))
    try:
        if tags is not None:
            top, left, bottom, right = dng_tags.active_area(tags)
            cfa = dng_tags.cfa(tags) if dng_tags.is_mosaic(tags) else None
            if cfa is not None and cfa.bayer and not is_foreign(tags):  # see `_with_tags`
                top, left = top + top % 2, left + left % 2
            height, width, white = bottom - top, right - left, dng_tags.white(tags) or dng_tags.largest(tags)
        else:
            with quiet(), rawpy.imread(BytesIO(data)) as raw:
                height, width, white = raw.sizes.height, raw.sizes.width, int(raw.white_level)
                metadata = metadata or spoken(BytesIO(data), raw)
    except Exception as error:  # rawpy raises whatever damaged bytes make it trip over
        raise _undecodable(path, tags) from error
    return RawHeader(width, height, white, metadata or FrameMetadata())


def read_raw_metadata(path: Path) -> FrameMetadata:
    """Read camera and exposure of a RAW file without its pixels; InputError as `read_raw`."""
    tags, metadata = _read_tags(path)
    if metadata is not None:
        return metadata
    try:
        with quiet(), rawpy.imread(str(path)) as raw, path.open("rb") as file:
            return spoken(file, raw)
    except Exception as error:
        raise _undecodable(path, tags) from error


def _undecodable(path: Path, tags: Directory | None) -> InputError:
    compression = None if tags is None else dng_tags.foreign_compression(tags)
    if compression is not None:
        return InputError(
            f"{path} holds its mosaic as {compression}, which could not be decoded: convert it to an "
            "uncompressed or losslessly compressed DNG, as Adobe DNG Converter does."
        )
    return InputError(f"{path} cannot be decoded as RAW: copy it again from the camera.")


def _read_tags(path: Path) -> tuple[Directory | None, FrameMetadata | None]:
    """Read the tags of a DNG and the EXIF of a TIFF-shaped file; None for any other.

    InputError if the file cannot be read or is cut off.
    """
    try:
        with path.open("rb") as file:
            return _tags(path, file)
    except IsADirectoryError as error:
        raise InputError(f"{path} is a folder: name a RAW file in it.") from error
    except FileNotFoundError as error:
        raise InputError(f"{path} does not exist: correct the path.") from error
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InputError(f"{path} cannot be read ({reason}): check the disk and its permissions.") from error


def _tags(path: Path, file: BinaryIO) -> tuple[Directory | None, FrameMetadata | None]:
    """The same of an open file."""
    head = file.read(4)
    if not head:
        raise InputError(f"{path} is empty: copy it again from the camera.")
    if head not in (b"II*\0", b"MM\0*"):
        if path.suffix.lower() == ".dng":
            raise InputError(f"{path} is not a DNG file: name a RAW file of a camera.")
        return None, None
    try:
        reader = TiffReader(file)
        directories = reader.directories()
        dng_tags.check_extents(directories, reader)
        return dng_tags.image_tags(directories), read_exif(reader)
    except TiffError as error:
        raise InputError(f"{path} is damaged or cut off: copy it again from the camera.") from error


def _foreign(path: Path) -> InputError:
    return InputError(
        f"{path} has other filters than red, green and blue, and is not mono: develop it to TIFF."
    )


def _cfa(path: Path, tags: Directory) -> Cfa:
    """The table of a DNG; InputError if it has none."""
    cfa = dng_tags.cfa(tags) if dng_tags.is_mosaic(tags) else None
    if cfa is None:
        raise _foreign(path)
    return cfa


def _of_dng(path: Path, tags: Directory, cfa: Cfa) -> RawMosaic:
    """A mosaic by the tags of a DNG alone; whatever the decoder trips over for damaged bytes."""
    pixels, area = read_pixels(path, tags), dng_tags.active_area(tags)
    return _with_tags(RawMosaic(pixels, cfa, ((0.0,),), dng_tags.largest(tags)), tags, area[:2])


def _of_linear_dng(path: Path, tags: Directory) -> RawMosaic:
    """Light of three colours, lossy or not, of unequal levels with black at 0 and white at 65535."""
    pixels = read_pixels(path, tags)
    black, white = dng_tags.levels(tags, *pixels.shape[:2])
    if pixels.ndim != 3 or pixels.shape[2] != 3:
        raise TiffError("the samples of a pixel are missing")
    level, top = float(black[0, 0, 0]), int(white[0])
    if pixels.dtype != np.uint16 or np.any(black != level) or np.any(white != top):
        share = (pixels.astype(np.float32) - black.astype(np.float32)) / (white - black).astype(np.float32)
        pixels, level, top = np.rint(65535 * share.clip(0, 1)).astype(np.uint16), 0.0, 65535
    return RawMosaic(
        pixels,
        None,
        ((level,),),
        top,
        neutral=dng_tags.neutral(tags, 3),
        camera_from_xyz=dng_colour.camera_from_xyz(tags, 3),
        noise_profile=dng_tags.noise_profile(tags),
        noise_shares=dng_tags.noise_shares(tags),
    )


def _decoded(path: Path, raw: rawpy.RawPy, tags: Directory | None) -> RawMosaic:
    """Pixels, table, levels and colour as LibRaw sees them."""
    check_picture(str(path), raw.sizes.raw_width, raw.sizes.raw_height, channels=2)
    pixels = raw.raw_image_visible
    if raw.raw_type != rawpy.RawType.Flat or pixels.ndim != 2 or pixels.dtype != np.uint16:
        raise _foreign(path)
    if tags is not None and raw.raw_image.shape != dng_tags.size(tags):
        raise _undecodable(path, tags)
    # No table that LibRaw knows is longer.
    sites = raw.raw_colors_visible[:TABLE, :TABLE]
    letters = raw.color_desc.decode("ascii", "replace")
    try:
        cfa = Cfa.MONO if raw.num_colors == 1 else Cfa.from_pattern(_places(sites, letters), "RGBW")
    except ValueError:
        raise _foreign(path) from None
    levels = np.array(raw.black_level_per_channel, np.float64)
    channels = len(cfa.letters)
    balance = [1 / gain if gain > 0 else 0.0 for gain in raw.camera_whitebalance[:channels]]
    matrix = raw.rgb_xyz_matrix[:channels]
    return RawMosaic(
        np.array(pixels),
        cfa,
        as_tile(levels[sites[: cfa.tile[0], : cfa.tile[1]]]),
        int(raw.white_level),
        neutral=dng_tags.as_neutral(balance, channels),
        camera_from_xyz=as_matrix(matrix) if np.any(matrix) and not cfa.mono else None,
    )


def _places(sites: npt.NDArray[np.integer], letters: str) -> npt.NDArray[np.intp]:
    """LibRaw's colour numbers as places in RGBW, -1 for other colours."""
    return np.asarray(np.array(["RGBW".find(letter) for letter in letters], np.intp)[sites])


def _with_tags(mosaic: RawMosaic, tags: Directory, corner: tuple[int, int]) -> RawMosaic:
    """The mosaic with what the tags of a DNG say better than LibRaw.

    corner: row and column of its first photosite in the stored image. LibRaw's visible area is the active
    area, begun one row or column later where that makes its corner even.
    """
    assert mosaic.cfa is not None
    height, width = mosaic.pixels.shape
    levels = dng_tags.black(tags, *corner, (height, width), mosaic.cfa.tile)
    black, offset = levels or (mosaic.black, None)
    channels = len(mosaic.cfa.letters)
    colour = None if mosaic.cfa.mono else dng_colour.camera_from_xyz(tags, channels)
    return replace(
        mosaic,
        black=black,
        black_offset=offset,
        white=dng_tags.white(tags) or mosaic.white,
        neutral=dng_tags.neutral(tags, channels) or mosaic.neutral,
        camera_from_xyz=colour or mosaic.camera_from_xyz,
        noise_profile=dng_tags.noise_profile(tags),
    )


def _checked(path: Path, mosaic: RawMosaic) -> RawMosaic:
    if not all(0 <= level < mosaic.white <= 65535 for row in mosaic.black for level in row):
        raise InputError(f"{path} has a black level above its white level: copy it again from the camera.")
    if mosaic.pixels.size == 0:
        raise InputError(f"{path} holds no pixels: copy it again from the camera.")
    stops = row_stops(mosaic)
    if stops:
        raise InputError(
            f"{path} has rows that differ by {stops:.1f} stops by turns, as Dual ISO and interlaced HDR "
            "record them: convert it to an ordinary DNG first, Magic Lantern's with cr2hdr."
        )
    return mosaic

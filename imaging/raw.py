"""RAW files of any make, read as a Bayer mosaic.

LibRaw (rawpy) decodes the pixels. What a DNG says in its tags is read from the tags themselves,
because LibRaw rounds black levels and keeps neither ColorMatrix1 nor NoiseProfile.
"""

import logging
from dataclasses import replace
from pathlib import Path

import exifread
import numpy as np
import rawpy

from imaging.cfa import Cfa
from imaging.errors import InputError
from imaging.exif import from_names, read_exif
from imaging.exposure import Exposure
from imaging.mosaic import FrameMetadata, Matrix, RawMosaic, as_matrix
from imaging.quiet import quiet
from imaging.tiff import Directory, TiffError, TiffReader, integers, numbers

SUFFIXES = frozenset(
    (
        ".3fr",
        ".arw",
        ".cr2",
        ".cr3",
        ".crw",
        ".dcr",
        ".dng",
        ".erf",
        ".fff",
        ".iiq",
        ".kdc",
        ".mef",
        ".mos",
        ".mrw",
        ".nef",
        ".nrw",
        ".orf",
        ".pef",
        ".raf",
        ".raw",
        ".rw2",
        ".rwl",
        ".sr2",
        ".srf",
        ".srw",
        ".x3f",
    )
)

BITS, COMPRESSION, PHOTOMETRIC, CFA_PHOTOMETRIC = 258, 259, 262, 32803
STRIPS, TILES = (273, 279), (324, 325)
DNG_VERSION, BLACK_REPEAT, BLACK, BLACK_DELTA_H, BLACK_DELTA_V, WHITE = (
    50706,
    50713,
    50714,
    50715,
    50716,
    50717,
)
COLOUR_MATRICES = ((50721, 50778), (50722, 50779))
ANALOG_BALANCE, NEUTRAL, NOISE_PROFILE = 50727, 50728, 51041
D65 = 21

logging.getLogger("exifread").addHandler(logging.NullHandler())


def is_raw(path: Path) -> bool:
    """Whether the suffix is one of a RAW file."""
    return path.suffix.lower() in SUFFIXES


def read_raw(path: Path) -> RawMosaic:
    """The mosaic of a RAW file, cut to its active area; InputError if it is none or is damaged.

    Orientation is not applied. Black levels and colour are those of the file.
    """
    directories = _checked_directories(path)
    try:
        with quiet(), rawpy.imread(str(path)) as raw:
            mosaic = _decoded(path, raw)
            spoken = _spoken(raw)
    except (rawpy.LibRawError, ValueError, TypeError, AttributeError, MemoryError) as error:
        raise InputError(f"{path} cannot be decoded as RAW: copy it again from the camera.") from error
    metadata = _metadata(path, spoken)
    dng = [d for d in directories if DNG_VERSION in d]
    if not dng:
        return replace(mosaic, metadata=metadata)
    return _with_tags(replace(mosaic, metadata=metadata), directories, dng[0], path)


def read_raw_metadata(path: Path) -> FrameMetadata:
    """What a RAW file says about camera and exposure, without decoding its pixels; InputError as above."""
    _checked_directories(path)
    try:
        with quiet(), rawpy.imread(str(path)) as raw:
            spoken = _spoken(raw)
    except rawpy.LibRawError as error:
        raise InputError(f"{path} cannot be read as RAW: copy it again from the camera.") from error
    return _metadata(path, spoken)


def _checked_directories(path: Path) -> list[Directory]:
    """The TIFF directories of a file, none if it is no TIFF; InputError if it is unreadable or cut off.

    LibRaw fills what a truncated file lacks with zeros, so the extents are checked here.
    """
    try:
        with path.open("rb") as file:
            size = file.seek(0, 2)
            if size == 0:
                raise InputError(f"{path} is empty: copy it again from the camera.")
            file.seek(0)
            if file.read(4) not in (b"II*\0", b"MM\0*"):
                if path.suffix.lower() == ".dng":
                    raise InputError(f"{path} is not a DNG file: name a RAW file of a camera.")
                return []
            directories = TiffReader(file).directories()
    except IsADirectoryError as error:
        raise InputError(f"{path} is a folder: name a RAW file in it.") from error
    except FileNotFoundError as error:
        raise InputError(f"{path} does not exist: correct the path.") from error
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}): check its permissions.") from error
    except TiffError as error:
        raise InputError(f"{path} is damaged or cut off: copy it again from the camera.") from error
    for directory in directories:
        for place, length in (STRIPS, TILES):
            starts, lengths = integers(directory, place), integers(directory, length)
            if any(a + b > size for a, b in zip(starts, lengths, strict=False)):
                raise InputError(f"{path} is cut off: copy it again from the camera.")
    return directories


def _decoded(path: Path, raw: rawpy.RawPy) -> RawMosaic:
    """Pixels, phase and levels as LibRaw sees them."""
    bayer = InputError(f"{path} is not a Bayer mosaic, which is all that rig reads: develop it to TIFF.")
    if raw.raw_type != rawpy.RawType.Flat:
        raise bayer
    pixels, pattern, letters = (
        raw.raw_image_visible,
        raw.raw_pattern,
        raw.color_desc.decode("ascii", "replace"),
    )
    if pattern is None or pattern.shape != (2, 2) or pixels.ndim != 2 or pixels.dtype != np.uint16:
        raise bayer
    try:
        cfa = Cfa("".join(letters[site] for site in pattern.reshape(-1)))
    except (ValueError, IndexError):
        raise bayer from None
    levels = raw.black_level_per_channel
    black = [float(levels[site]) for site in pattern.reshape(-1)]
    white = int(raw.white_level)
    if not all(0 <= level < white for level in black):
        raise InputError(f"{path} has black {black} and white {white}, which cannot be: copy it again.")
    balance = [1 / gain if gain > 0 else 0.0 for gain in raw.camera_whitebalance[:3]]
    matrix = raw.rgb_xyz_matrix[:3]
    return RawMosaic(
        np.array(pixels),
        cfa,
        (black[0], black[1], black[2], black[3]),
        white,
        neutral=_neutral({NEUTRAL: tuple(balance)}),
        camera_from_xyz=as_matrix(matrix) if np.any(matrix) else None,
    )


def _spoken(raw: rawpy.RawPy) -> FrameMetadata:
    """What LibRaw found out about the exposure; it knows makers whose files are no TIFF."""
    other = raw.other
    time, f_number, iso = other.shutter_speed, other.aperture, other.iso_speed
    exposure = None
    if time > 0:
        exposure = Exposure(
            time=time, f_number=f_number if f_number > 0 else None, iso=iso if iso > 0 else None
        )
    return FrameMetadata(exposure=exposure, focal_length_mm=other.focal_length or None)


def _metadata(path: Path, spoken: FrameMetadata) -> FrameMetadata:
    """EXIF of the file where there is some; where it is silent, what LibRaw found out."""
    try:
        with path.open("rb") as file:
            found = read_exif(file)
    except TiffError:
        found = _exifread(path)
    return replace(
        found,
        exposure=found.exposure or spoken.exposure,
        focal_length_mm=found.focal_length_mm or spoken.focal_length_mm,
    )


def _exifread(path: Path) -> FrameMetadata:
    """EXIF of containers that are no TIFF (CR3, RAF)."""
    try:
        with path.open("rb") as file:
            tags = exifread.process_file(file, details=False)
    except Exception:  # the parser of damaged bytes raises whatever it trips over
        return FrameMetadata()
    return from_names({name: getattr(tag, "values", ()) for name, tag in tags.items()})


def _with_tags(mosaic: RawMosaic, directories: list[Directory], main: Directory, path: Path) -> RawMosaic:
    """The same mosaic with what the DNG says exactly: black and white, colour, noise."""
    image = next((d for d in directories if integers(d, PHOTOMETRIC)[:1] == (CFA_PHOTOMETRIC,)), main)
    tags = {**main, **image}
    white = max((*integers(tags, WHITE), 0))
    white = white or mosaic.white
    black = _black(tags) or mosaic.black
    if not all(0 <= level < white <= 65535 for level in black):
        raise InputError(f"{path} has black {black} and white {white}, which cannot be: copy it again.")
    profile = numbers(tags, NOISE_PROFILE)
    # one pair for all planes or a pair each; the green one stands for all of them
    pair = profile[2:4] if len(profile) >= 6 else profile[:2]
    valid = len(pair) == 2 and all(np.isfinite(pair)) and pair[0] > 0 and pair[1] >= 0
    return replace(
        mosaic,
        black=black,
        white=white,
        neutral=_neutral(tags) or mosaic.neutral,
        camera_from_xyz=_matrix(tags) or mosaic.camera_from_xyz,
        noise_profile=(pair[0], pair[1]) if valid else None,
    )


def _black(tags: Directory) -> tuple[float, float, float, float] | None:
    """BlackLevel of the four sites; the mean of the deltas of rows and columns is added."""
    levels = numbers(tags, BLACK)
    rows, columns = (*integers(tags, BLACK_REPEAT), 1, 1)[:2]
    if not levels or len(levels) != rows * columns or rows not in (1, 2) or columns not in (1, 2):
        return None
    shift = sum(float(np.mean(numbers(tags, tag) or (0.0,))) for tag in (BLACK_DELTA_H, BLACK_DELTA_V))
    tile = np.tile(np.reshape(levels, (rows, columns)), (2 // rows, 2 // columns)).reshape(-1) + shift
    return float(tile[0]), float(tile[1]), float(tile[2]), float(tile[3])


def _neutral(tags: Directory) -> tuple[float, float, float] | None:
    values = numbers(tags, NEUTRAL)
    if len(values) != 3 or not all(0 < value < 1e6 for value in values):
        return None
    largest = max(values)
    return values[0] / largest, values[1] / largest, values[2] / largest


def _matrix(tags: Directory) -> Matrix | None:
    """ColorMatrix for D65 if the file has one for it, else the first there is, with AnalogBalance."""
    found = [(integers(tags, light)[:1] == (D65,), numbers(tags, tag)) for tag, light in COLOUR_MATRICES]
    for _, values in sorted(found, key=lambda pair: not pair[0]):
        if len(values) == 9 and any(values):
            balance = numbers(tags, ANALOG_BALANCE)
            matrix = np.reshape(values, (3, 3)) * np.reshape(balance if len(balance) == 3 else 1.0, (-1, 1))
            return as_matrix(matrix)
    return None

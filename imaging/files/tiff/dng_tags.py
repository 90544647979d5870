"""Levels, extents and noise in the tags of a DNG (Adobe DNG specification 1.7)."""

from collections.abc import Sequence

import numpy as np

from imaging.arrays import Array, Array32
from imaging.files.tiff.directory import Directory, TiffError, TiffReader, integers, numbers
from imaging.sensor.cfa import Cfa, Tile, as_tile, repeated

SUBFILE_TYPE, WIDTH, HEIGHT, BITS, COMPRESSION, PHOTOMETRIC, SAMPLES = 254, 256, 257, 258, 259, 262, 277
ROWS_PER_STRIP, STRIP_OFFSETS, STRIP_SIZES, PLANAR = 278, 273, 279, 284
TILE_WIDTH, TILE_HEIGHT, TILE_OFFSETS, TILE_SIZES = 322, 323, 324, 325
SOFTWARE, SAMPLE_FORMAT, CFA_REPEAT, CFA_PATTERN, CFA_PLANES, CFA_LAYOUT = (
    305,
    339,
    33421,
    33422,
    50710,
    50711,
)
DNG_VERSION, DNG_BACKWARD, UNIQUE_MODEL, RAW_UNIQUE_ID = 50706, 50707, 50708, 50781
BLACK_REPEAT, BLACK, BLACK_DELTA_H, BLACK_DELTA_V, WHITE = 50713, 50714, 50715, 50716, 50717
DEFAULT_SCALE, CROP_ORIGIN, CROP_SIZE, ACTIVE_AREA = 50718, 50719, 50720, 50829
MATRIX_1, MATRIX_2, MATRIX_3, ANALOG_BALANCE, NEUTRAL = 50721, 50722, 52531, 50727, 50728
CALIBRATION_1, CALIBRATION_2, CALIBRATION_3 = 50723, 50724, 52530
ILLUMINANT_1, ILLUMINANT_2, ILLUMINANT_3 = 50778, 50779, 52529
CAMERA_SIGNATURE, PROFILE_SIGNATURE = 50931, 50932
BASELINE_EXPOSURE, BASELINE_NOISE, BASELINE_SHARPNESS, LINEAR_LIMIT = 50730, 50731, 50732, 50734
NOISE_PROFILE, LINEARIZATION = 51041, 50712
FILL_ORDER, ROW_INTERLEAVE, COLUMN_INTERLEAVE = 266, 50975, 52547
_OF_ONE_IMAGE = frozenset((*range(254, 260), 262, 266, 273, 277, 278, 279, 284, 317, *range(322, 326), 339))
"""Tags that speak of the image of their own directory alone."""

CFA_PHOTOMETRIC, LINEAR_PHOTOMETRIC = 32803, 34892
COLOUR_CODES = {0: "R", 1: "G", 2: "B", 6: "W"}
"""Colour codes of CFAPattern and CFAPlaneColor (TIFF/EP; EXIF's CFAPattern)."""
LOSSLESS_JPEG = 7
FOREIGN_COMPRESSIONS = {8: "deflate", 32946: "deflate", 34892: "lossy JPEG", 52546: "JPEG XL"}
"""Allowed by the specification, and beyond LibRaw for the whole numbers of a mosaic."""
D65 = 21

Offset = Array32 | None


def check_extents(directories: Sequence[Directory], file: TiffReader) -> None:
    """TiffError unless all strips and tiles lie within the file and, in a DNG, none is missing.

    Readers fill what is missing with zeros without a word, so this comes before them. A copy that
    broke off may have its full size and zeros at the end, so lossless JPEG has to have its end.
    """
    is_dng = any(DNG_VERSION in directory for directory in directories)
    for directory in directories:
        for places, lengths in ((STRIP_OFFSETS, STRIP_SIZES), (TILE_OFFSETS, TILE_SIZES)):
            starts, sizes = integers(directory, places), integers(directory, lengths)
            if any(start + length > file.size for start, length in zip(starts, sizes, strict=False)):
                raise TiffError("pixels lead past the end")
            if is_dng and (len(starts) != len(sizes) or 0 in starts or 0 in sizes):
                raise TiffError("pixels are missing")
        if is_dng and _number(directory, PHOTOMETRIC) in (CFA_PHOTOMETRIC, LINEAR_PHOTOMETRIC):
            _check_complete(directory)
            if _number(directory, COMPRESSION) == LOSSLESS_JPEG:
                _check_ends(directory, file)


def _check_complete(directory: Directory) -> None:
    width, height = (_number(directory, tag) for tag in (WIDTH, HEIGHT))
    tile_width, tile_height = (_number(directory, tag) for tag in (TILE_WIDTH, TILE_HEIGHT))
    if not width or not height:
        raise TiffError("the image has no size")
    if ACTIVE_AREA in directory:
        # LibRaw believes any area, and then gives more pixels than there are
        top, left, bottom, right = (*integers(directory, ACTIVE_AREA), 0, 0, 0, 0)[:4]
        if not (top < bottom <= height and left < right <= width):
            raise TiffError("the active area is not in the image")
    if tile_width and tile_height:
        expected = -(-width // tile_width) * -(-height // tile_height)
        sizes = integers(directory, TILE_SIZES)
    else:
        expected = -(-height // (_number(directory, ROWS_PER_STRIP) or height))
        sizes = integers(directory, STRIP_SIZES)
    if len(sizes) < expected:
        raise TiffError("strips or tiles are missing")
    bits = width * (_number(directory, BITS) or 16) * (_number(directory, SAMPLES) or 1)
    if _number(directory, COMPRESSION) == 1 and sum(sizes) < bits * height // 8:
        raise TiffError("pixels are missing")


def _check_ends(directory: Directory, file: TiffReader) -> None:
    for places, lengths in ((STRIP_OFFSETS, STRIP_SIZES), (TILE_OFFSETS, TILE_SIZES)):
        starts, sizes = integers(directory, places), integers(directory, lengths)
        for start, size in zip(starts, sizes, strict=True):
            tail = min(size, 64)  # some writers pad
            if b"\xff\xd9" not in file.read(start + size - tail, tail):
                raise TiffError("a strip or tile has no end")


def image_tags(directories: Sequence[Directory]) -> Directory | None:
    """The tags about the mosaic of a DNG over those of its main directory; None if it is no DNG.

    The mosaic is the largest image that NewSubfileType calls neither reduced, nor enhanced by a program.
    """
    main = next((directory for directory in directories if DNG_VERSION in directory), None)
    if main is None:
        return None
    mosaics = [d for d in directories if _number(d, PHOTOMETRIC) in (CFA_PHOTOMETRIC, LINEAR_PHOTOMETRIC)]
    whole = [directory for directory in mosaics if _number(directory, SUBFILE_TYPE) == 0] or mosaics
    largest = max(whole, key=lambda d: _number(d, WIDTH) * _number(d, HEIGHT), default=main)
    return {tag: value for tag, value in main.items() if tag not in _OF_ONE_IMAGE} | largest


def interleaving(tags: Directory) -> tuple[int, int]:
    """RowInterleaveFactor and ColumnInterleaveFactor; TiffError for more fields than rows or columns."""
    factors = _number(tags, ROW_INTERLEAVE) or 1, _number(tags, COLUMN_INTERLEAVE) or 1
    if any(factor > max(length, 1) for factor, length in zip(factors, size(tags), strict=True)):
        raise TiffError("more fields than rows or columns")
    return factors


def foreign_compression(tags: Directory) -> str | None:
    """Return what the mosaic is compressed by, if it is something that LibRaw does not decode."""
    return FOREIGN_COMPRESSIONS.get(_number(tags, COMPRESSION))


def size(tags: Directory) -> tuple[int, int]:
    """Height and width of the stored mosaic, px."""
    return _number(tags, HEIGHT), _number(tags, WIDTH)


def active_area(tags: Directory) -> tuple[int, int, int, int]:
    """Top, left, bottom and right of the photosites that count."""
    height, width = size(tags)
    area = integers(tags, ACTIVE_AREA)
    return (area[0], area[1], area[2], area[3]) if len(area) == 4 else (0, 0, height, width)


def is_developed(tags: Directory) -> bool:
    """Return whether all pixels have three integer colours: demosaicked light (LinearRaw)."""
    return (
        integers(tags, SAMPLE_FORMAT) in ((), (1,), (1, 1, 1))
        and _number(tags, PHOTOMETRIC) == LINEAR_PHOTOMETRIC
        and integers(tags, SAMPLES) == (3,)
    )


def is_mosaic(tags: Directory) -> bool:
    """Return whether there is a sample of whole numbers a photosite, which sees red, green, blue, or all."""
    return (
        integers(tags, SAMPLE_FORMAT) in ((), (1,))
        and _number(tags, PHOTOMETRIC) in (CFA_PHOTOMETRIC, LINEAR_PHOTOMETRIC)
        and integers(tags, SAMPLES) in ((), (1,))
        and integers(tags, CFA_LAYOUT) in ((), (1,))
    )


def cfa(tags: Directory) -> Cfa | None:
    """The table of the mosaic from its first active photosite on; None if rig does not know it."""
    if _number(tags, PHOTOMETRIC) == LINEAR_PHOTOMETRIC:
        return Cfa.MONO
    repeat, sites = integers(tags, CFA_REPEAT), tags.get(CFA_PATTERN, ())
    codes = list(sites) if isinstance(sites, bytes) else [int(site) for site in integers(tags, CFA_PATTERN)]
    if len(repeat) != 2 or min(repeat) < 1 or len(codes) != repeat[0] * repeat[1]:
        return None
    if integers(tags, CFA_PLANES) not in ((), tuple(sorted(set(codes)))):
        return None
    try:
        text = "".join(COLOUR_CODES[code] for code in codes)
        return Cfa.from_pattern(np.reshape(["RGBW".index(letter) for letter in text], repeat), "RGBW")
    except (KeyError, ValueError):
        return None


def black(
    tags: Directory, top: int, left: int, shape: tuple[int, int], tile: tuple[int, int]
) -> tuple[Tile, Offset] | None:
    """Black of the photosites of a window of the stored image.

    BlackLevel repeats from the corner of the active area; BlackLevelDeltaV and BlackLevelDeltaH add to its
    rows and columns.

    Args:
        tags: Tags of the image.
        top: First row of the window in the stored image.
        left: First column of the window in the stored image.
        shape: Rows and columns of the window.
        tile: Rows and columns of the tile of the mosaic.

    Returns:
        The mean of each site of the tile, DN, and float32 of `shape` that says how far each photosite departs
        from the mean of its site, DN; None for the latter where no photosite does. None in place of both if
        the file has no levels, or they contradict its size.
    """
    levels = numbers(tags, BLACK)
    rows, columns = (*integers(tags, BLACK_REPEAT)[:2], 1, 1)[:2]
    (height, width), (down, across) = shape, tile
    if min(rows, columns) < 1 or len(levels) != rows * columns or height < down or width < across:
        return None
    area = (*integers(tags, ACTIVE_AREA)[:2], 0, 0)[:2]
    deltas = (
        _deltas(tags, BLACK_DELTA_V, top - area[0], height),
        _deltas(tags, BLACK_DELTA_H, left - area[1], width),
    )
    varied = down % rows > 0 or across % columns > 0 or any(np.ptp(delta) > 0 for delta in deltas)
    y, x = np.arange(height if varied else down), np.arange(width if varied else across)
    stated = np.reshape(levels, (rows, columns))
    whole = stated[np.ix_((y + top - area[0]) % rows, (x + left - area[1]) % columns)]
    whole = whole + deltas[0][y, None] + deltas[1][x]
    means = np.zeros(tile)
    for row, column in np.ndindex(tile):
        means[row, column] = np.mean(whole[row::down, column::across])
    offset = None
    if varied:
        offset = whole.astype(np.float32) - repeated(means.astype(np.float32), height, width)
    return as_tile(means), offset


def levels(tags: Directory, height: int, width: int) -> tuple[Array, Array]:
    """Black and white of the three samples of a pixel of the active area; TiffError if these are no levels.

    Black is [1, 1, 3], or [H, W, 3] where it varies: by BlackLevelRepeatDim, BlackLevelDeltaV and DeltaH.
    """
    low, high = numbers(tags, BLACK) or (0.0,), numbers(tags, WHITE) or (float(largest(tags)),)
    rows, columns = (*integers(tags, BLACK_REPEAT)[:2], 1, 1)[:2]
    if (
        min(rows, columns) < 1
        or len(low) not in (rows * columns, 3 * rows * columns)
        or len(high) not in (1, 3)
    ):
        raise TiffError("the levels are not those of three colours")
    black = np.reshape(low, (rows, columns, -1)).astype(np.float64)
    if (rows, columns) != (1, 1):
        black = black[np.ix_(np.arange(height) % rows, np.arange(width) % columns)]
    down, across = _deltas(tags, BLACK_DELTA_V, 0, height), _deltas(tags, BLACK_DELTA_H, 0, width)
    if down.any() or across.any():
        black = black + down[:, None, None] + across[:, None]
    black = np.broadcast_to(black, (*black.shape[:2], 3))
    top = black.mean((0, 1)) + limit(tags) * (np.broadcast_to(high, 3) - black.mean((0, 1)))
    if not np.all((black >= 0) & (black < top)):
        raise TiffError("black is above white")
    return black, top


def _deltas(tags: Directory, tag: int, start: int, length: int) -> Array:
    """Return what rows or columns add to black from `start` on; 0 where the tag is missing or too short."""
    deltas = np.array(numbers(tags, tag)[max(start, 0) :][:length], np.float64)
    return deltas if len(deltas) == length else np.zeros(length)


def largest(tags: Directory) -> int:
    """The largest number that the bits of a sample hold."""
    return int(2 ** (_number(tags, BITS) or 16) - 1)


def limit(tags: Directory) -> float:
    """LinearResponseLimit: the linear share of the range above black; 1 without the tag."""
    share = next(iter(numbers(tags, LINEAR_LIMIT)), 1.0)
    return share if 0 < share < 1 else 1.0


def white(tags: Directory) -> int | None:
    """WhiteLevel, or what LinearResponseLimit leaves of it."""
    level, share = _number(tags, WHITE), limit(tags)
    if share == 1:
        return level or None
    black = float(np.mean(numbers(tags, BLACK) or (0.0,)))
    return int(black + share * ((level or largest(tags)) - black))


def as_neutral(values: Sequence[float], channels: int) -> tuple[float, ...] | None:
    """Return the response of each channel to a neutral surface, the largest 1; None if the values are
    impossible.

    If only R, G and B are given, W is their sum.
    """
    if channels == 4 and len(values) == 3:
        values = (*values, sum(values))
    if len(values) != channels or not all(0 < value < 1e6 for value in values):
        return None
    return tuple(value / max(values) for value in values)


def neutral(tags: Directory, channels: int) -> tuple[float, ...] | None:
    """AsShotNeutral, as `as_neutral` has it."""
    return as_neutral(numbers(tags, NEUTRAL), channels)


def noise_profile(tags: Directory) -> tuple[float, float] | None:
    """(S, O) of NoiseProfile on 0..1 of `white`; of a file with a pair for each colour the green one."""
    values = numbers(tags, NOISE_PROFILE)
    if len(values) < 2 or len(values) % 2:
        return None
    slope, offset = values[2:4] if len(values) >= 6 else values[:2]
    share = limit(tags)
    return (slope / share, offset / share**2) if 0 < slope < np.inf and 0 <= offset < np.inf else None


def noise_shares(tags: Directory) -> tuple[float, ...] | None:
    """The variance of each of three channels over that of `noise_profile`; None where it is the same."""
    values = numbers(tags, NOISE_PROFILE)
    slopes = values[::2]
    if len(values) != 6 or noise_profile(tags) is None or not min(slopes) > 0 or len(set(slopes)) == 1:
        return None
    return tuple(slope / slopes[1] for slope in slopes)


def _number(directory: Directory, tag: int) -> int:
    return next(iter(integers(directory, tag)), 0)

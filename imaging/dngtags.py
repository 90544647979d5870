"""What the tags of a DNG say: extents, levels, colour and noise (Adobe DNG specification 1.4)."""

from collections.abc import Sequence

import numpy as np

from imaging.mosaic import Matrix, as_matrix
from imaging.tiff import Directory, TiffError, TiffReader, integers, numbers

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
MATRIX_1, MATRIX_2, ANALOG_BALANCE, NEUTRAL = 50721, 50722, 50727, 50728
ILLUMINANT_1, ILLUMINANT_2 = 50778, 50779
BASELINE_EXPOSURE, BASELINE_NOISE, BASELINE_SHARPNESS, LINEAR_LIMIT = 50730, 50731, 50732, 50734
NOISE_PROFILE = 51041

CFA_PHOTOMETRIC = 32803
LOSSLESS_JPEG = 7
D65 = 21

Black = tuple[float, float, float, float]


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
        if is_dng and integers(directory, PHOTOMETRIC) == (CFA_PHOTOMETRIC,):
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
    """The tags about the mosaic of a DNG over those of its main directory; None if it is no DNG."""
    main = next((directory for directory in directories if DNG_VERSION in directory), None)
    if main is None:
        return None
    mosaics = [d for d in directories if integers(d, PHOTOMETRIC) == (CFA_PHOTOMETRIC,)]
    largest = max(mosaics, key=lambda d: _number(d, WIDTH) * _number(d, HEIGHT), default=main)
    return {**main, **largest}


def size(tags: Directory) -> tuple[int, int]:
    """Height and width of the stored mosaic, px."""
    return _number(tags, HEIGHT), _number(tags, WIDTH)


def is_bayer(tags: Directory) -> bool:
    """Whether the photosites see red, green and blue and hold whole numbers."""
    planes, kinds = integers(tags, CFA_PLANES), integers(tags, SAMPLE_FORMAT)
    return planes in ((), (0, 1, 2)) and kinds in ((), (1,))


def black(tags: Directory, top: int, left: int) -> Black | None:
    """BlackLevel of the four sites of the 2x2 tile at row `top`, column `left` of the stored image.

    The file counts from the corner of its active area. Rows and columns add their mean delta.
    """
    levels = numbers(tags, BLACK)
    rows, columns = (*integers(tags, BLACK_REPEAT)[:2], 1, 1)[:2]
    if len(levels) != rows * columns or rows not in (1, 2) or columns not in (1, 2):
        return None
    shift = sum(float(np.mean(numbers(tags, tag) or (0.0,))) for tag in (BLACK_DELTA_H, BLACK_DELTA_V))
    area = (*integers(tags, ACTIVE_AREA)[:2], 0, 0)[:2]
    tile = np.tile(np.reshape(levels, (rows, columns)), (2 // rows, 2 // columns)) + shift
    tile = np.roll(tile, (area[0] - top, area[1] - left), axis=(0, 1)).reshape(-1)
    return float(tile[0]), float(tile[1]), float(tile[2]), float(tile[3])


def white(tags: Directory) -> int | None:
    """WhiteLevel."""
    return _number(tags, WHITE) or None


def as_neutral(values: Sequence[float]) -> tuple[float, float, float] | None:
    """Camera RGB of a neutral surface, scaled to a largest value of 1; None if it cannot be one."""
    if len(values) != 3 or not all(0 < value < 1e6 for value in values):
        return None
    largest = max(values)
    return values[0] / largest, values[1] / largest, values[2] / largest


def neutral(tags: Directory) -> tuple[float, float, float] | None:
    """AsShotNeutral."""
    return as_neutral(numbers(tags, NEUTRAL))


def camera_from_xyz(tags: Directory) -> Matrix | None:
    """AnalogBalance x ColorMatrix: the one for D65 if the file names one, else the first."""
    pairs = [(ILLUMINANT_1, MATRIX_1), (ILLUMINANT_2, MATRIX_2)]
    pairs.sort(key=lambda pair: integers(tags, pair[0]) != (D65,))
    for _, tag in pairs:
        values = numbers(tags, tag)
        if len(values) == 9 and any(values):
            balance = numbers(tags, ANALOG_BALANCE)
            gains = balance if len(balance) == 3 and all(balance) else (1.0, 1.0, 1.0)
            return as_matrix(np.reshape(values, (3, 3)) * np.reshape(gains, (3, 1)))
    return None


def noise_profile(tags: Directory) -> tuple[float, float] | None:
    """(S, O) of NoiseProfile; of a file with a pair for each colour the green one."""
    values = numbers(tags, NOISE_PROFILE)
    if len(values) < 2 or len(values) % 2:
        return None
    slope, offset = values[2:4] if len(values) == 6 else values[:2]
    return (slope, offset) if 0 < slope < np.inf and 0 <= offset < np.inf else None


def _number(directory: Directory, tag: int) -> int:
    return next(iter(integers(directory, tag)), 0)

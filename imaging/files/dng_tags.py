"""What the tags of a DNG say: extents, levels and noise (Adobe DNG specification 1.4)."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from imaging.files.tiff import Directory, TiffError, TiffReader, integers, numbers

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
NOISE_PROFILE = 51041

CFA_PHOTOMETRIC = 32803
LOSSLESS_JPEG = 7
FOREIGN_COMPRESSIONS = {8: "deflate", 34892: "lossy JPEG", 52546: "JPEG XL"}
"""Allowed by the specification, and beyond LibRaw for the whole numbers of a mosaic."""
D65 = 21

Black = tuple[float, float, float, float]
Offset = npt.NDArray[np.float32] | None


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


def foreign_compression(tags: Directory) -> str | None:
    """What the mosaic is compressed by, if it is something that LibRaw does not decode."""
    return FOREIGN_COMPRESSIONS.get(_number(tags, COMPRESSION))


def size(tags: Directory) -> tuple[int, int]:
    """Height and width of the stored mosaic, px."""
    return _number(tags, HEIGHT), _number(tags, WIDTH)


def is_bayer(tags: Directory) -> bool:
    """Whether the photosites see red, green and blue and hold whole numbers."""
    planes, kinds = integers(tags, CFA_PLANES), integers(tags, SAMPLE_FORMAT)
    return planes in ((), (0, 1, 2)) and kinds in ((), (1,))


def black(tags: Directory, top: int, left: int, height: int, width: int) -> tuple[Black, Offset] | None:
    """Black of the photosites of a window that begins at row `top`, column `left` of the stored image.

    The mean of each site of the 2x2 tile, DN, and float32 [height, width] that says how far each photosite
    departs from the mean of its site; None where none does. BlackLevel repeats from the corner of the
    active area; BlackLevelDeltaV and BlackLevelDeltaH add to its rows and columns. None if the file has no
    levels, or they contradict its size.
    """
    levels = numbers(tags, BLACK)
    rows, columns = (*integers(tags, BLACK_REPEAT)[:2], 1, 1)[:2]
    if min(rows, columns) < 1 or len(levels) != rows * columns or min(height, width) < 2:
        return None
    area = (*integers(tags, ACTIVE_AREA)[:2], 0, 0)[:2]
    deltas = (
        _deltas(tags, BLACK_DELTA_V, top - area[0], height),
        _deltas(tags, BLACK_DELTA_H, left - area[1], width),
    )
    varied = rows > 2 or columns > 2 or any(np.ptp(delta) > 0 for delta in deltas)
    down, right = (np.arange(size if varied else 2) for size in (height, width))
    tile = np.reshape(levels, (rows, columns))
    whole = tile[np.ix_((down + top - area[0]) % rows, (right + left - area[1]) % columns)]
    whole = whole + deltas[0][down, None] + deltas[1][right]
    means = [float(np.mean(whole[row::2, column::2])) for row, column in np.ndindex(2, 2)]
    offset = None
    if varied:
        offset = whole.astype(np.float32)
        for mean, (row, column) in zip(means, np.ndindex(2, 2), strict=True):
            offset[row::2, column::2] -= np.float32(mean)
    return (means[0], means[1], means[2], means[3]), offset


def _deltas(tags: Directory, tag: int, start: int, length: int) -> npt.NDArray[np.float64]:
    """What rows or columns add to black from `start` on; 0 where the tag is missing or too short."""
    found = np.array(numbers(tags, tag)[max(start, 0) :][:length], np.float64)
    return found if len(found) == length else np.zeros(length)


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


def noise_profile(tags: Directory) -> tuple[float, float] | None:
    """(S, O) of NoiseProfile; of a file with a pair for each colour the green one."""
    values = numbers(tags, NOISE_PROFILE)
    if len(values) < 2 or len(values) % 2:
        return None
    slope, offset = values[2:4] if len(values) == 6 else values[:2]
    return (slope, offset) if 0 < slope < np.inf and 0 <= offset < np.inf else None


def _number(directory: Directory, tag: int) -> int:
    return next(iter(integers(directory, tag)), 0)

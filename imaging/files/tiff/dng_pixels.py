"""The pixels of a DNG that LibRaw does not know how to read: decoded by tifffile and imagecodecs."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import tifffile

from imaging.arrays import AnyArray
from imaging.compute.memory import check_picture
from imaging.files.tiff import dng_tags
from imaging.files.tiff.directory import Directory, TiffError, integers


def is_foreign(tags: Directory) -> bool:
    """Return whether LibRaw takes the samples of a Bayer mosaic for others, or cannot decode them."""
    return (
        dng_tags.interleaving(tags) != (1, 1)
        or dng_tags.foreign_compression(tags) is not None
        or integers(tags, dng_tags.FILL_ORDER) == (2,)
    )


def in_place(pixels: AnyArray, rows: int, columns: int) -> AnyArray:
    """Deinterlace samples [H, W, ...] of an image stored as interleaved fields of rows and columns.

    RowInterleaveFactor and ColumnInterleaveFactor (DNG 1.7): the first field has every row that is a multiple
    of the factor, the second those behind them, and so on.
    """
    for axis, factor in enumerate((rows, columns)):
        if factor > 1:
            length = pixels.shape[axis]
            stored = np.concatenate([np.arange(field, length, factor) for field in range(factor)])
            pixels = np.take(pixels, np.argsort(stored), axis=axis)
    return pixels


def read_pixels(path: Path, tags: Directory) -> npt.NDArray[np.uint16]:
    """Numbers of the active area, uint16 [H, W] or [H, W, samples], linearised as the file says.

    tags: of its largest raw image. TiffError if that cannot be found or has another size; InputError if it is
    larger than the memory; and whatever the decoder trips over for damaged bytes.
    """
    height, width = dng_tags.size(tags)
    samples = next(iter(integers(tags, dng_tags.SAMPLES)), 1)
    check_picture(str(path), width, height, channels=2 * samples)
    with tifffile.TiffFile(path) as file:
        file.pages.useframes = False
        page = next((page for page in _pages(file.pages) if _is_raw(page, height, width)), None)
        if page is None:
            raise TiffError("the raw image is missing")
        pixels = np.asarray(page.asarray())
        if page.axes.startswith("S"):  # planes
            pixels = np.moveaxis(pixels, 0, -1)
    if pixels.shape[:2] != (height, width) or pixels.dtype not in (np.uint8, np.uint16):
        raise TiffError("the raw image is of another size")
    table = np.array(integers(tags, dng_tags.LINEARIZATION), np.uint16)
    if table.size:
        pixels = table[np.minimum(pixels, table.size - 1)]
    pixels = in_place(pixels, *dng_tags.interleaving(tags))
    top, left, bottom, right = dng_tags.active_area(tags)
    return np.ascontiguousarray(pixels[top:bottom, left:right], np.uint16)


def _pages(pages: Any) -> Iterator[Any]:
    """Every page, and those that it holds below it."""
    for page in pages:
        yield page
        if page.pages is not None:
            yield from _pages(page.pages)


def _is_raw(page: Any, height: int, width: int) -> bool:
    kinds = (dng_tags.CFA_PHOTOMETRIC, dng_tags.LINEAR_PHOTOMETRIC)
    return (page.imagelength, page.imagewidth) == (height, width) and int(page.photometric) in kinds

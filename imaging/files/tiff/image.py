"""TIFF images of 8 or 16 bits as code values: grey or RGB, however they are stored."""

import logging
from io import BytesIO
from typing import Any

import numpy as np
import tifffile

from imaging.arrays import AnyArray
from imaging.compute.memory import check_picture
from imaging.files.tiff.directory import TiffReader
from imaging.files.tiff.pages import photograph

# without a handler, Python would print the library's complaints about damaged files
logging.getLogger("tifffile").addHandler(logging.NullHandler())

INVERTED, GREY, RGB, YCBCR = 0, 1, 2, 6
_JPEG = (6, 7)
_ASSOCIATED, _UNASSOCIATED = 1, 2
_ROWS = 64
"""Rows that are computed with at a time: copies of a large picture would fill the memory."""
_SUBSAMPLING, _COEFFICIENTS, _REFERENCE = 530, 529, 532
_SIGNED, _FLOAT = 2, 3
_GREY_CURVE = 291
_INTERLACE = 34857
"""Number of the field that a picture is, of TIFF/EP; 0: of none."""


class UnfitError(Exception):
    """A sound file of a kind that is not read; the message ends the sentence that the path begins."""


def decode_tiff(data: bytes, name: str) -> AnyArray:
    """Code values of the photograph (`pages`), uint8 or uint16 [H, W] or [H, W, C]; of 2 or 4 alpha is last.

    UnfitError for a kind that is not read, InputError for one larger than the memory, and whatever the
    decoder trips over for damaged bytes.
    """
    with tifffile.TiffFile(BytesIO(data)) as file:
        page: Any = _page(file, photograph(TiffReader(BytesIO(data)))[0])
        if page.photometric not in (INVERTED, GREY, RGB, YCBCR):
            raise UnfitError("is a TIFF that is neither grey nor RGB: convert it to RGB")
        _check_samples(page)
        if page.dtype not in (np.uint8, np.uint16) or page.bitspersample not in (8, 16):
            raise UnfitError("is a TIFF of other than 8 or 16 bits: convert it to one of them")
        luma = page.photometric == YCBCR and page.compression not in _JPEG  # whose decoder gives RGB
        if luma and _numbers(page, _SUBSAMPLING, (2, 2)) != (1, 1):
            raise UnfitError("is a TIFF of subsampled YCbCr without JPEG: convert it to RGB")
        _check_extents(page, len(data))
        channels = page.samplesperpixel * page.imagedepth
        check_picture(name, page.imagewidth, page.imagelength, channels)
        if page.is_tiled:  # each is decoded whole
            check_picture(name, page.tilewidth, page.tilelength, channels)
        codes = np.asarray(page.asarray())
        if page.axes.startswith("S"):  # planes
            codes = np.moveaxis(codes, 0, -1)
        codes = codes.astype(codes.dtype.newbyteorder("="))
        if page.photometric == INVERTED:  # alpha is not
            codes = np.iinfo(codes.dtype).max - codes if codes.ndim == 2 else _first_inverted(codes)
        if luma:
            codes = _rgb(codes, page)
        return _with_alpha(codes, page)


def _page(file: tifffile.TiffFile, offset: int) -> Any:
    """The page whose directory stands at an offset."""
    first = file.pages.first
    if first.offset == offset:
        return first
    file.filehandle.seek(offset)
    return tifffile.TiffPage(file, index=0)


def _check_samples(page: Any) -> None:
    """UnfitError for samples that are no codes of the usual scale, by the tag that says so."""
    if page.sampleformat == _FLOAT:
        raise UnfitError(
            "is a TIFF of floating-point samples (SampleFormat 3): convert it to EXR, if it is linear "
            "light, or to 16 bits"
        )
    if page.sampleformat == _SIGNED:
        raise UnfitError("is a TIFF of signed samples (SampleFormat 2): convert it to unsigned ones")
    if page.imagedepth > 1:
        raise UnfitError("is a TIFF of a volume (ImageDepth): convert it to a picture")
    if _GREY_CURVE in page.tags and page.photometric in (INVERTED, GREY):
        raise UnfitError(
            "is a TIFF of densities (GrayResponseCurve), which rig does not read: convert it to RGB"
        )
    if _INTERLACE in page.tags and np.any(np.asarray(page.tags[_INTERLACE].value) != 0):
        raise UnfitError(
            "is a TIFF of every other row of a picture (Interlace): convert it to one of all its rows"
        )
    top = float(2**page.bitspersample - 1)
    if page.photometric == RGB and _REFERENCE in page.tags:
        levels = np.reshape(_numbers(page, _REFERENCE, (0, top) * 3), (3, 2))
        if np.any(levels != (0, top)):
            raise UnfitError(
                "is a TIFF whose black and white are not those of its codes (ReferenceBlackWhite): "
                "convert it to RGB of the full range"
            )


def _first_inverted(codes: AnyArray) -> AnyArray:
    codes = codes.copy()
    codes[..., 0] = np.iinfo(codes.dtype).max - codes[..., 0]
    return codes


def _rgb(codes: AnyArray, page: Any) -> AnyArray:
    """YCbCr as RGB: TIFF 6.0, section 21."""
    top = float(np.iinfo(codes.dtype).max)
    middle = (top + 1) / 2
    red, green, blue = _numbers(page, _COEFFICIENTS, (0.299, 0.587, 0.114))
    reference = np.reshape(_numbers(page, _REFERENCE, (0, top, middle, top, middle, top)), (3, 2))
    black, white = reference[:, 0], reference[:, 1]
    ranges = np.array([top, middle - 1, middle - 1])
    rgb = codes[..., :3].copy()
    for rows in range(0, len(codes), _ROWS):
        strip = (codes[rows : rows + _ROWS, :, :3] - black) * (ranges / (white - black))
        y, cb, cr = np.moveaxis(strip, -1, 0)
        r, b = y + (2 - 2 * red) * cr, y + (2 - 2 * blue) * cb
        g = (y - red * r - blue * b) / green
        rgb[rows : rows + _ROWS] = np.rint(np.stack([r, g, b], axis=-1)).clip(0, top)
    return rgb if codes.shape[2] == 3 else np.concatenate([rgb, codes[..., 3:]], axis=-1)


def _with_alpha(codes: AnyArray, page: Any) -> AnyArray:
    """The page's samples without extra ones other than unpremultiplied alpha."""
    if codes.ndim < 3:
        return codes
    colours = 1 if page.photometric in (INVERTED, GREY) else 3
    extra = next(iter(page.extrasamples), 0)
    if extra not in (_ASSOCIATED, _UNASSOCIATED):
        return codes[..., :colours]
    codes = codes[..., : colours + 1]
    if extra == _ASSOCIATED:
        top, alpha = np.iinfo(codes.dtype).max, codes[..., -1:].astype(np.float32)
        straight = codes[..., :-1] * (top / np.maximum(alpha, 1))
        codes = np.concatenate([np.rint(straight).clip(0, top).astype(codes.dtype), codes[..., -1:]], -1)
    return codes


def _numbers(page: Any, tag: int, default: tuple[float, ...]) -> tuple[float, ...]:
    """The values of a tag, rationals as numbers; ValueError if they are not as many as the default."""
    if tag not in page.tags:
        return default
    values = np.atleast_1d(np.asarray(page.tags[tag].value, np.float64))
    if len(values) == 2 * len(default):
        values = values[::2] / values[1::2]
    if len(values) != len(default) or not np.all(np.isfinite(values)):
        raise ValueError("a tag of another length")
    return tuple(values.tolist())


def _check_extents(page: Any, size: int) -> None:
    """Raise unless every strip and tile of the page is in the file: tifffile fills missing ones with
    zeros.
    """
    sizes = page.databytecounts
    ends = [start + length for start, length in zip(page.dataoffsets, sizes, strict=True)]
    if len(ends) < np.prod(page.chunked) or not ends or max(ends) > size or 0 in sizes:
        raise ValueError("cut off")
    if page.compression == 1 and sum(sizes) < page.nbytes:
        raise ValueError("cut off")

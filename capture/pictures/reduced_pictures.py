"""Reduced pictures during the examination of a bracket, so that 24 megapixels fit."""

from dataclasses import dataclass
from itertools import product

import cv2
import numpy as np

from imaging.arrays import Array32, Mask
from imaging.colour.spaces import srgb_decode
from imaging.merge.linear_frame import LinearFrame, SensorSignalNoise
from imaging.sensor.cfa import Cfa, cell_means

ENOUGH = 1 << 21
"""Samples of a picture from which exposure ratios are taken; of larger ones blocks are averaged."""
TYPICAL = SensorSignalNoise(slope=1.5e-4, floor=2e-6)
"""Noise of a RAW file that states none: that of a sensor with a well of 7,000 electrons."""
CODE_SIGMA = 1.5 / 255
"""Noise of a developed code."""
TOP_CODE = 254 / 255
WIDEST = 400
"""Patches in a row of a developed photograph, at most."""
_LIGHT = np.asarray(srgb_decode(np.linspace(0.0, 1.0, 65_536)), np.float32)
"""Light by code: those of 8 and of 16 bits all lie on this grid."""


@dataclass(frozen=True, eq=False)
class PatchCodes:
    """Green of a developed photograph in square patches: mean, least, largest code 0..255, float32 [h, w].

    The mean is NaN where a patch holds a pixel that a mask hides.
    """

    mean: Array32
    low: Array32
    high: Array32


@dataclass(frozen=True, eq=False)
class ReducedPicture:
    """Picture for examination.

    green: float32 [h, w], green light of each 2x2 pixels, or of each cell of a mosaic that of the channel
    with most photosites, 1 is white; clipped: whether any of them is,
    or excluded by a mask. noise: of `green`. linear: the same light as the
    sensor saw it, for exposure ratios, or None where a camera developed it; patches: then its codes.
    """

    green: Array32
    clipped: Mask
    noise: SensorSignalNoise
    linear: LinearFrame | None
    patches: PatchCodes | None


def of_raw(frame: LinearFrame, cfa: Cfa | None) -> ReducedPicture:
    """Reduce a RAW frame; the greens of each cell are one sample. Invalid photosites do not count. What is
    not valid in it counts for nothing.
    """
    noise = frame.noise if isinstance(frame.noise, SensorSignalNoise) else TYPICAL
    useless = frame.saturated | ~frame.valid
    green = 1 if cfa is None else cfa.densest
    count = 1.0 if cfa is None else float((cfa.pattern == green).mean()) * cfa.cell**2
    return ReducedPicture(
        cell_means(frame.signal, cfa)[..., green],
        cell_means(useless, cfa)[..., green] > 0,
        SensorSignalNoise(noise.slope / count, noise.floor / count),
        _reduced(frame, cfa),
        None,
    )


def of_photo(pixels: Array32, counts: Mask | None = None) -> ReducedPicture:
    """Reduce a developed photograph [H, W, 3], 0..1, taken for sRGB until its curve is known.

    counts: bool [H, W], which pixels a mask lets through; None: all.
    """
    codes = np.ascontiguousarray(pixels[..., 1])
    green = _halved(_LIGHT[np.rint(65_535 * np.clip(codes, 0.0, 1.0)).astype(np.uint16)])
    # Under a square root, which sRGB nearly is, equal noise of the codes is noise like that of photons.
    slope = (2 * CODE_SIGMA) ** 2 / 4
    height, width = green.shape
    clipped = np.zeros((height, width), bool)
    for row, column in product((0, 1), repeat=2):
        clipped |= codes[row : 2 * height : 2, column : 2 * width : 2] >= TOP_CODE
    clipped |= _hidden(counts, green)
    return ReducedPicture(
        green, clipped, SensorSignalNoise(slope, slope / 255), None, _patches(codes, counts)
    )


def of_light(light: Array32, counts: Mask | None = None) -> ReducedPicture:
    """Linear light [H, W, 3], which is merged already: brought to where 1 is its brightest percentile.

    counts: as of `of_photo`.
    """
    finite = np.nan_to_num(light[..., 1], nan=0.0, posinf=0.0, neginf=0.0)
    shown = finite if counts is None or not counts.any() else finite[counts]
    top = max(float(np.percentile(shown, 99.0)), 1e-30)
    green = _halved(np.asarray(finite / top, np.float32))
    return ReducedPicture(
        green, (green >= 1.0) | _hidden(counts, green), SensorSignalNoise(1e-6, 1e-10), None, None
    )


def _halved(image: Array32) -> Array32:
    """Mean of each 2x2 samples; an odd last row or column is left out."""
    height, width = image.shape[0] // 2, image.shape[1] // 2
    return np.asarray(
        cv2.resize(image[: 2 * height, : 2 * width], (width, height), interpolation=cv2.INTER_AREA)
    )


def _hidden(counts: Mask | None, green: Array32) -> Mask:
    """Return which samples have a pixel that a mask hides, of the shape of `green`."""
    if counts is None:
        return np.zeros(green.shape, bool)
    return _halved(counts.astype(np.float32)) < 1.0


def _patches(codes: Array32, counts: Mask | None) -> PatchCodes:
    size = max(3, codes.shape[1] // WIDEST)
    height, width = codes.shape[0] // size, codes.shape[1] // size
    cut = 255 * codes[: height * size, : width * size]
    square, middle = np.ones((size, size), np.uint8), np.s_[size // 2 :: size, size // 2 :: size]
    mean = np.asarray(cv2.resize(cut, (width, height), interpolation=cv2.INTER_AREA), np.float32)
    if counts is not None:
        whole = cv2.erode(counts[: height * size, : width * size].astype(np.uint8), square)[middle]
        mean[whole == 0] = np.nan
    return PatchCodes(
        mean,
        np.asarray(cv2.erode(cut, square)[middle], np.float32),
        np.asarray(cv2.dilate(cut, square)[middle], np.float32),
    )


def _reduced(frame: LinearFrame, cfa: Cfa | None) -> LinearFrame:
    """A large mosaic as its channels [h, w, channels] of block means; one is saturated if any site is.

    It is valid if all are.
    """
    height, width = frame.signal.shape[:2]
    if height * width <= ENOUGH:
        return frame
    channels, cell = (3, 1) if cfa is None else (len(cfa.letters), cfa.cell)
    side = int(np.ceil(np.sqrt(channels * height * width / (cell**2 * ENOUGH))))
    signal, clipped, hidden = (
        _blocks(cell_means(values, cfa), side) for values in (frame.signal, frame.saturated, ~frame.valid)
    )
    saturated, valid = clipped > 0, hidden == 0
    noise = frame.noise
    if isinstance(noise, SensorSignalNoise):
        noise = SensorSignalNoise(noise.slope / side**2, noise.floor / side**2, noise.shares)
    none = np.zeros(signal.shape, bool)
    return LinearFrame(signal, frame.k, saturated, none, valid, None, noise, ceiling=1.0)


def _blocks(image: Array32, side: int) -> Array32:
    """Means [h, w, channels] over whole squares of that many pixels a side."""
    high, wide = image.shape[0] // side, image.shape[1] // side
    cut = image[: high * side, : wide * side]
    return np.asarray(cut.reshape(high, side, wide, side, -1).mean((1, 3)), np.float32)

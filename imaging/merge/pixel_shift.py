"""Pixel shift: exposures between which the sensor moved by one photosite, as light not demosaicked.

Of four, each place of the scene is seen through every filter of a Bayer tile: red, blue and twice green.
Which way the sensor moved follows from the pictures, so that the order of no maker has to be known.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple, TypeVar

import cv2
import numpy as np
import numpy.typing as npt

from imaging.arrays import Array32, Floats, Mask
from imaging.demosaicking.demosaic import demosaic
from imaging.errors import InputError
from imaging.sensor.cfa import Cfa, bilinear
from imaging.sensor.mosaic import RawMosaic

COUNT = 4
"""Exposures of a group. Those of 8 and 16, by half photosites, are refused."""
MOST_MOVED = 0.25
"""Share of moved pixels above which a group is rejected."""

Number = TypeVar("Number", bound=np.generic)
Shift = tuple[int, int]
_STEPS: tuple[Shift, ...] = tuple((row, column) for row in (-1, 0, 1) for column in (-1, 0, 1))
_CLASSES = {(0, 1), (1, 0), (1, 1)}
"""Offsets by which the other frames have to differ from the first, odd or even in rows and columns."""
_PLACING, _RESPONDING = 0.1, 0.01
"""Differences of two samples of one place beside noise: positioning error of the sensor in photosites, and
non-uniformity of their response.
"""
_WINDOW, _UNLIKELY, _HOT = 5, 4.0, 25.0
"""Window width in photosites, the mean of squares over variance that noise does not reach in a window (1,
with a standard deviation of 0.3; 2, where a file states half of its noise), and the cap for one photosite: a
hot one is no motion.
"""


class Combined(NamedTuple):
    """Merged pixel-shift group. moved: the share of the picture taken from its first frame only."""

    light: RawMosaic
    moved: float


def combined(frames: Sequence[RawMosaic]) -> Combined:
    """A picture of three colours a photosite, uint16 [H, W, 3] without CFA, on the grid of the first frame.

    Green is the mean of two samples: `noise_shares` says by how much the variance of each channel differs
    from that of `noise_profile`, which is green's. A channel is saturated where any of its samples is. What
    the outermost rows and columns, which the sensor left, lack is that of the pixel beside. Where the two
    samples of green contradict each other something moved, and the first frame alone is demosaicked.
    InputError for frames that are no such group, or where much of the picture moved.
    """
    first = frames[0]
    _must_fit(frames)
    assert first.cfa is not None
    level = float(np.mean(first.black))
    codes = [frame.pixels.astype(np.float32) - frame.black_map() + level for frame in frames]
    shape, channels = first.pixels.shape, first.cfa.channels(*first.pixels.shape)
    total, count = np.zeros((*shape, 3), np.float32), np.zeros((*shape, 3), np.uint8)
    full, apart = np.zeros((*shape, 3), bool), np.zeros(shape, np.float32)
    for frame, code, shift in zip(frames, codes, shifts(codes, first.cfa), strict=True):
        sites, inside = _moved(channels, shift), _inside(shape, shift)
        for channel in range(3):
            mine = inside & (sites == channel)
            if channel == 1:  # of the two samples the difference
                apart[mine] = _moved(code, shift)[mine] - apart[mine]
            total[..., channel][mine] += _moved(code, shift)[mine]
            count[..., channel] += mine
            full[..., channel] |= mine & _moved(frame.saturated(), shift)
    light = total / np.maximum(count, 1)
    known = (count[..., 1] == 2) & ~full[..., 1]
    moved = _contradicted(light[..., 1] - level, np.where(known, apart, 0), first)
    share = float(moved.mean())
    if share > MOST_MOVED:
        raise InputError(
            f"the scene or the camera moved between them in {share:.0%} of the picture: shoot from a tripod "
            "what does not move, or import only the first of every group, without --pixel-shift."
        )
    if share:
        light[moved] = demosaic(codes[0] - level, first.cfa).rgb[moved] + level
        full[moved] = (cv2.dilate(first.saturated().astype(np.uint8), np.ones((5, 5), np.uint8)) > 0)[
            moved, None
        ]
        count[moved] = 1
    light[full] = first.white
    pixels = np.rint(np.clip(light, 0, first.white - ~full)).astype(np.uint16)
    _fill(pixels, count > 0)
    profile = first.noise_profile
    together = replace(
        first,
        pixels=pixels,
        cfa=None,
        black=((level,),),
        black_offset=None,
        noise_profile=None if profile is None else (profile[0] / 2, profile[1] / 2),
        noise_shares=(2.0, 1.0, 2.0),
    )
    return Combined(together, share)


def shifts(codes: Sequence[Array32], cfa: Cfa) -> list[Shift]:
    """Rows and columns by which each frame has to be moved to lie on the first, whose CFA all have.

    Every frame is held against the colours between the photosites of the first. InputError where a frame fits
    best as it is: the sensor did not move, or by half a photosite.
    """
    guess, _ = bilinear(codes[0], cfa)
    channels = cfa.channels(*codes[0].shape)
    middle = (slice(2, -2), slice(2, -2))
    costs = []
    for code in codes[1:]:
        cost = {}
        for shift in _STEPS:
            sites = _moved(channels, shift)[..., None].astype(np.intp)
            expected = np.take_along_axis(guess, sites, 2)[..., 0]
            cost[shift] = float(np.mean(np.abs(_moved(code, shift) - expected)[middle]))
        costs.append(cost)
    best = [min(cost, key=lambda shift: cost[shift]) for cost in costs]
    classes = [(abs(row), abs(column)) for row, column in best]
    if set(classes) != _CLASSES:
        raise InputError(
            f"the sensor did not move by one photosite between them: shoot groups of {COUNT} (those of 8 and "
            "16, by half photosites, are not read), or import without --pixel-shift."
        )
    return [(0, 0), *best]


def _contradicted(green: Floats, apart: Floats, first: RawMosaic) -> Mask:
    """Return where the two samples of green, `apart` so much, differ by more than noise: bool [H, W].

    green: their mean above black, DN. Without a noise profile the noise is that of most of the picture.
    """
    level = np.maximum(green, 0)
    slopes = [np.roll(green, -1, axis) - np.roll(green, 1, axis) for axis in (0, 1)]
    allowed = (_PLACING / 2) ** 2 * (slopes[0] ** 2 + slopes[1] ** 2) + 2 * (_RESPONDING * level) ** 2
    span = first.white - float(np.mean(first.black))
    if first.noise_profile is not None:
        slope, offset = first.noise_profile
        noise = 2 * (slope * span * level + offset * span**2)
    else:
        edges = np.unique(np.quantile(level, np.linspace(0, 1, 17)))
        bins = np.clip(np.searchsorted(edges, level, "right") - 1, 0, max(len(edges) - 2, 0))
        present = np.unique(bins)
        spread = [np.quantile(apart[bins == one] ** 2, 0.75) for one in present]
        noise = np.interp(bins, present, spread) / 1.323 + 1 / 6  # of a chi-square; rounding of both
    chi = np.minimum(apart**2 / (noise + allowed), _HOT).astype(np.float32)
    chi = cv2.blur(chi, (_WINDOW, _WINDOW))
    near = np.ones((_WINDOW, _WINDOW), np.uint8)
    return np.asarray(cv2.dilate((chi > _UNLIKELY).astype(np.uint8), near) > 0)


def _must_fit(frames: Sequence[RawMosaic]) -> None:
    first = frames[0]
    if len(frames) != COUNT:
        raise InputError(
            f"{len(frames)} files are not a complete pixel-shift group, which has {COUNT}: add the rest."
        )
    for frame in frames:
        if frame.cfa is None or not frame.cfa.bayer:
            raise InputError("pixel shift needs Bayer mosaics: import these files as they are.")
        if (frame.cfa, frame.pixels.shape, frame.white) != (first.cfa, first.pixels.shape, first.white):
            raise InputError("files of one group differ in size, CFA or white level: sort them into groups.")


def _moved(image: npt.NDArray[Number], shift: Shift) -> npt.NDArray[Number]:
    return np.roll(image, shift, axis=(0, 1))


def _inside(shape: tuple[int, ...], shift: Shift) -> Mask:
    """Return where a moved frame has photosites of its own, and none that came in from the other side."""
    inside = np.ones(shape, bool)
    for axis, step in enumerate(shift):
        if step:
            inside[(slice(None),) * axis + (0 if step > 0 else -1,)] = False
    return inside


def _fill(pixels: npt.NDArray[np.uint16], known: Mask) -> None:
    """Give unknown values at the border those of the pixel beside, in place."""
    height, width = pixels.shape[:2]
    for row, column, channel in np.argwhere(~known):
        pixels[row, column, channel] = pixels[
            min(max(row, 1), height - 2), min(max(column, 1), width - 2), channel
        ]

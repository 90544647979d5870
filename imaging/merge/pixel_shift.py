"""Pixel shift: exposures between which the sensor moved by one photosite, as light not demosaicked.

Of four, each place of the scene is seen through every filter of a Bayer tile: red, blue and twice green.
Which way the sensor moved follows from the pictures, so that the order of no maker has to be known.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from imaging.cfa import Cfa, bilinear
from imaging.errors import InputError
from imaging.mosaic import RawMosaic

COUNT = 4
"""Exposures of a group. Sixteen, of half photosites, are not read."""

Number = TypeVar("Number", bound=np.generic)
Shift = tuple[int, int]
_STEPS: tuple[Shift, ...] = tuple((row, column) for row in (-1, 0, 1) for column in (-1, 0, 1))
_CLASSES = {(0, 1), (1, 0), (1, 1)}
"""By which the others have to differ from the first, odd or even in rows and columns."""


def combined(frames: Sequence[RawMosaic]) -> RawMosaic:
    """A picture of three colours a photosite, uint16 [H, W, 3] without CFA, on the grid of the first frame.

    Green is the mean of two samples: `noise_shares` says by how much the variance of each channel differs
    from that of `noise_profile`, which is green's. A channel is saturated where any of its samples is. What
    the outermost rows and columns, which the sensor left, lack is that of the pixel beside. InputError for
    frames that are no such group.
    """
    first = frames[0]
    _must_fit(frames)
    assert first.cfa is not None
    level = float(np.mean(first.black))
    codes = [frame.pixels.astype(np.float32) - frame.black_map() + level for frame in frames]
    shape, channels = first.pixels.shape, first.cfa.channels(*first.pixels.shape)
    total, count = np.zeros((*shape, 3), np.float32), np.zeros((*shape, 3), np.uint8)
    full = np.zeros((*shape, 3), bool)
    for frame, code, shift in zip(frames, codes, shifts(codes, first.cfa), strict=True):
        seen, inside = _moved(channels, shift), _inside(shape, shift)
        for channel in range(3):
            mine = inside & (seen == channel)
            total[..., channel][mine] += _moved(code, shift)[mine]
            count[..., channel] += mine
            full[..., channel] |= mine & _moved(frame.saturated(), shift)
    light = total / np.maximum(count, 1)
    light[full] = first.white
    pixels = np.rint(np.clip(light, 0, first.white - ~full)).astype(np.uint16)
    _fill(pixels, count > 0)
    profile = first.noise_profile
    return replace(
        first,
        pixels=pixels,
        cfa=None,
        black=((level,),),
        black_offset=None,
        noise_profile=None if profile is None else (profile[0] / 2, profile[1] / 2),
        noise_shares=(2.0, 1.0, 2.0),
    )


def shifts(codes: Sequence[npt.NDArray[np.float32]], cfa: Cfa) -> list[Shift]:
    """Rows and columns by which each frame has to be moved to lie on the first, whose CFA all have.

    Every frame is held against the colours between the photosites of the first. InputError where a frame fits
    best as it is: the sensor did not move.
    """
    guess, _ = bilinear(codes[0], cfa)
    channels = cfa.channels(*codes[0].shape)
    middle = (slice(2, -2), slice(2, -2))
    costs = []
    for code in codes[1:]:
        cost = {}
        for shift in _STEPS:
            seen = _moved(channels, shift)[..., None].astype(np.intp)
            expected = np.take_along_axis(guess, seen, 2)[..., 0]
            cost[shift] = float(np.mean(np.abs(_moved(code, shift) - expected)[middle]))
        costs.append(cost)
    best = [min(cost, key=lambda shift: cost[shift]) for cost in costs]
    classes = [(abs(row), abs(column)) for row, column in best]
    if set(classes) != _CLASSES:
        raise InputError("the sensor did not move by one photosite between them: import them as they are.")
    return [(0, 0), *best]


def _must_fit(frames: Sequence[RawMosaic]) -> None:
    first = frames[0]
    if len(frames) != COUNT:
        raise InputError(f"{len(frames)} files are no group of pixel shift, which has {COUNT}: add the rest.")
    for frame in frames:
        if frame.cfa is None or not frame.cfa.bayer:
            raise InputError("pixel shift is read of Bayer mosaics only: import these files as they are.")
        if (frame.cfa, frame.pixels.shape, frame.white) != (first.cfa, first.pixels.shape, first.white):
            raise InputError("files of one group differ in size, CFA or white level: sort them into groups.")


def _moved(image: npt.NDArray[Number], shift: Shift) -> npt.NDArray[Number]:
    return np.roll(image, shift, axis=(0, 1))


def _inside(shape: tuple[int, ...], shift: Shift) -> npt.NDArray[np.bool_]:
    """Where a moved frame has photosites of its own, and none that came in from the other side."""
    inside = np.ones(shape, bool)
    for axis, step in enumerate(shift):
        if step:
            inside[(slice(None),) * axis + (0 if step > 0 else -1,)] = False
    return inside


def _fill(pixels: npt.NDArray[np.uint16], known: npt.NDArray[np.bool_]) -> None:
    """Give unknown values at the border those of the pixel beside, in place."""
    height, width = pixels.shape[:2]
    for row, column, channel in np.argwhere(~known):
        pixels[row, column, channel] = pixels[
            min(max(row, 1), height - 2), min(max(column, 1), width - 2), channel
        ]

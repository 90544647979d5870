"""Repeated frames of one exposure: their mean, their scatter in time, and tiles of both."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from imaging.arrays import Array, Array32, Floats, Integers, Mask

Kind = TypeVar("Kind", bound=np.generic)

TILE = 8
"""Side of a tile, in photosites of one CFA site: small enough for the fall of light not to matter."""
Period = tuple[int, int]
EVEN: Period = (2, 2)
"""Tile of even and odd rows and columns: that of Bayer; and of mono, since many sensors are read out by
it.
"""
FULL = 0.995
"""Share of the largest DN of a stack from which a photosite may be full."""


@dataclass(frozen=True, eq=False)
class Stack:
    """Repeated frames of one exposure, in DN.

    time: s; of flats any measure of the exposure. frames: their number. halves: float32 [2, H, W], means of
    every other frame, which share the fixed pattern and nothing else (of one frame, twice that frame).
    variance: float32 [H, W], in time, of frames brought to the level of the first. levels: float64
    [frames, sites], mean of the CFA sites in each frame. rows: variance of what is common to a row of a
    frame, DN^2, and its standard error. tile: rows and columns after which the CFA repeats, whose sites are
    separate.
    """

    time: float
    frames: int
    halves: Array32
    variance: Array32
    levels: Array
    rows: tuple[float, float]
    tile: Period = EVEN

    @property
    def mean(self) -> Array32:
        """Mean of all frames, float32 [H, W]."""
        count = np.array((self.frames - self.frames // 2, max(self.frames // 2, 1)), np.float32)
        return np.asarray(np.tensordot(count / count.sum(), self.halves, 1), np.float32)


def gather(
    frames: Iterable[npt.NDArray[np.uint16]], time: float, black: float | None = None, tile: Period = EVEN
) -> Stack:
    """Read repeated frames one after another.

    Args:
        frames: Frames of one exposure, DN [H, W].
        time: Exposure time, s; of flats any measure of the exposure.
        black: Black level of flats, DN: their light flickers, so frames are scaled to one level above it.
            Darks (None) are shifted to one level instead.
        tile: Rows and columns after which the CFA repeats, as of `Stack`.

    Returns:
        Mean and scatter of the frames.

    Raises:
        ValueError: There are no frames, or their sizes differ.
    """
    first: Array32 | None = None
    previous = sums = square = halves = np.zeros(0, np.float32)
    levels: list[Array] = []
    common: list[Array] = []
    middle, top, count = 0.0, 0, 0
    for pixels in frames:
        if first is not None and pixels.shape != first.shape:
            raise ValueError("repeated frames are of one size")
        top = max(top, int(pixels.max()))
        levels.append(np.array([float(plane.mean(dtype=np.float64)) for plane in sites(pixels, tile)]))
        level, frame = float(levels[-1].mean()), pixels.astype(np.float32)
        if first is None:
            first, middle = frame, level
            sums, square = np.zeros_like(frame), np.zeros_like(frame)
            halves = np.zeros((2, *frame.shape), np.float32)
        # Differences from the first frame are small, so that their squares keep their digits.
        halves[count % 2] += frame - first
        if black is None:
            frame = frame - np.float32(level - middle)
        elif level > black:
            # What is at the ceiling does not follow the light.
            scale = np.where(
                pixels < FULL * top, np.float32((middle - black) / (level - black)), np.float32(1)
            )
            frame = (frame - np.float32(black)) * scale + np.float32(black)
        difference = frame - first
        sums += difference
        square += difference * difference
        if count:
            common.append((frame - previous).mean(axis=1, dtype=np.float64))
        previous = frame
        count += 1
    if first is None:
        raise ValueError("a stack takes one frame or more")
    numbers = np.array((count - count // 2, max(count // 2, 1)), np.float32)
    halves = np.asarray(halves / numbers[:, None, None] + first, np.float32)
    if count == 1:
        halves[1] = halves[0]
    variance = np.asarray((square - sums * sums / count) / max(count - 1, 1), np.float32)
    if black is not None:
        # What is scaled to the level of the first frame has its noise scaled too.
        apart = np.array([level.mean() for level in levels]) - black
        variance /= np.float32(np.mean((apart[0] / np.maximum(apart, 1e-6)) ** 2)) if apart[0] > 0 else 1.0
    return Stack(time, count, halves, variance, np.array(levels), _rows(common, variance), tile)


def _rows(common: list[Array], variance: Array32) -> tuple[float, float]:
    """Variance of row noise from row means of differences of frames, less what single photosites explain."""
    if not common:
        return 0.0, float("inf")
    spread = np.array([float(row.var(ddof=1)) / 2 for row in common])
    height, width = variance.shape
    alone = float(np.median(variance))
    excess = (float(spread.mean()) - alone / width) / (1 - 1 / width)
    # Differences of neighbouring frames share a frame: 3/2 times the variance of independent ones.
    error = float(spread.mean()) * np.sqrt(2 / height * 1.5 / len(common))
    return max(excess, 0.0), float(error)


def sites(image: npt.NDArray[Kind], tile: Period = EVEN) -> npt.NDArray[Kind]:
    """The planes [sites, H / rows, W / columns] of the sites of a tile, what completes none left out."""
    rows, columns = tile
    down, across = image.shape[0] // rows, image.shape[1] // columns
    cut = image[: rows * down, : columns * across].reshape(down, rows, across, columns)
    return cut.transpose(1, 3, 0, 2).reshape(rows * columns, down, across)


@dataclass(frozen=True, eq=False)
class Tiles:
    """Tiles of a stack; all arrays [N].

    site: CFA site, in reading order; row, column: of the tile's middle, in photosites from the corner of the
    image; mean: DN; variance: DN^2 in time; count: of photosites.
    """

    site: Integers
    row: Array
    column: Array
    mean: Array
    variance: Array
    count: Array


def tiles(stack: Stack, usable: Mask) -> Tiles:
    """Means of the usable photosites of a CFA site over `TILE` x `TILE` of them, fewer of a large tile."""
    mask = sites(usable, stack.tile).astype(np.float64)
    mean, variance = sites(stack.mean, stack.tile), sites(stack.variance, stack.tile)
    side = max(2 * TILE // max(stack.tile), 2)
    count = _pooled(mask, side)
    filled = count >= side * side / 2
    weight = np.maximum(count, 1.0)
    site, row, column = np.nonzero(filled)
    return Tiles(
        site=site,
        row=stack.tile[0] * side * (row.astype(np.float64) + 0.5),
        column=stack.tile[1] * side * (column.astype(np.float64) + 0.5),
        mean=(_pooled(mean * mask, side) / weight)[filled],
        variance=(_pooled(variance * mask, side) / weight)[filled],
        count=count[filled],
    )


def _pooled(planes: Floats, side: int) -> Array:
    """Sums over whole squares: [sites, h, w] -> [sites, h / side, w / side]."""
    down, across = planes.shape[1] // side, planes.shape[2] // side
    cut = planes[:, : down * side, : across * side].astype(np.float64)
    return np.asarray(cut.reshape(len(planes), down, side, across, side).sum(axis=(2, 4)))

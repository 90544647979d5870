"""Colour filter arrays: tables of any period, crops that shift them, mosaics and their bilinear pictures."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from math import lcm
from typing import ClassVar, TypeVar

import numpy as np
import numpy.typing as npt

from imaging.arrays import Array, Array32, Bytes, Floats, Mask

Tile = tuple[tuple[float, ...], ...]
"""Values of the sites of a tile that repeats over the photosites, row by row."""

Site = TypeVar("Site", bound=np.generic)
LETTERS = ("RGB", "RGBW", "W")


@dataclass(frozen=True)
class Cfa:
    """A colour filter array, by the letters of the tile that repeats from the first photosite on.

    rows: of the tile, such as ("RG", "GB"): R, G and B, with or without W, which has no filter; or W alone,
    which is mono. ValueError for other letters, and rows of unequal length. As text "RG/GB".
    """

    rows: tuple[str, ...]

    RGGB: ClassVar["Cfa"]
    BGGR: ClassVar["Cfa"]
    GRBG: ClassVar["Cfa"]
    GBRG: ClassVar["Cfa"]
    X_TRANS: ClassVar["Cfa"]
    """Fujifilm's (US 8,531,563); bodies begin it at any of its places."""
    QUAD_BAYER: ClassVar["Cfa"]
    KODAK_RGBW: ClassVar["Cfa"]
    """Compton and Hamilton, US 8,139,130: every other photosite without a filter."""
    MONO: ClassVar["Cfa"]

    def __post_init__(self) -> None:
        if len({len(row) for row in self.rows}) != 1 or self.letters not in LETTERS:
            raise ValueError(
                f"{self} is no Cfa: rows of equal length hold R, G and B, with or without W, or W alone"
            )

    @classmethod
    def of(cls, text: str) -> "Cfa":
        """The table with this text; ValueError if it is not a table."""
        return cls(tuple(text.split("/")))

    @classmethod
    def from_pattern(cls, pattern: npt.ArrayLike, letters: str = "RGB") -> "Cfa":
        """The table whose sites [h, w] are these places among `letters`, in its least period.

        ValueError if there is no such table.
        """
        sites = np.asarray(pattern)
        if sites.ndim != 2 or sites.size == 0 or sites.min() < 0 or sites.max() >= len(letters):
            raise ValueError(f"{sites.tolist()} is no Cfa of {letters}")
        for axis in (0, 1):
            length = sites.shape[axis]
            repeats = (n for n in range(1, length + 1) if length % n == 0 and _repeats(sites, n, axis))
            sites = sites.take(range(next(repeats)), axis)
        return cls(tuple("".join(letters[int(site)] for site in row) for row in sites))

    def __str__(self) -> str:
        return "/".join(self.rows)

    @property
    def letters(self) -> str:
        """Channels, in the order in which `pattern` counts them: RGB, RGBW or W."""
        letters = {letter for row in self.rows for letter in row}
        return "".join(sorted(letters, key=lambda letter: "RGBW".find(letter)))

    @property
    def period(self) -> tuple[int, int]:
        """Rows and columns of the tile."""
        return len(self.rows), len(self.rows[0])

    @property
    def tile(self) -> tuple[int, int]:
        """Rows and columns after which it repeats, and even and odd ones too, as many sensors are read."""
        return lcm(2, self.period[0]), lcm(2, self.period[1])

    @cached_property
    def pattern(self) -> Bytes:
        """Channel of each site of the tile, uint8 [h, w]; 0 red, 1 green, 2 blue, 3 white; of mono 0."""
        letters = self.letters
        return np.array([[letters.index(letter) for letter in row] for row in self.rows], np.uint8)

    @property
    def bayer(self) -> bool:
        """True for the four Bayer phases."""
        return self in BAYER

    @property
    def mono(self) -> bool:
        """True if all photosites have the same spectral response."""
        return self.letters == "W"

    @property
    def densest(self) -> int:
        """The channel with the most photosites, which resolves detail best."""
        return int(np.argmax(np.bincount(self.pattern.reshape(-1))))

    @cached_property
    def cell(self) -> int:
        """Side of the least square, 2 or more, that holds every channel wherever a multiple of it begins.

        A mosaic seen in such squares has all colours in each: 2 of Bayer and mono, 3 of X-Trans.
        """
        whole = lcm(*self.tile)
        channels = self.channels(whole, whole)
        for side in (n for n in range(2, whole) if whole % n == 0):
            squares = channels.reshape(whole // side, side, whole // side, side)
            if all((squares == channel).any((1, 3)).all() for channel in range(len(self.letters))):
                return side
        return whole

    def cropped(self, top: int, left: int) -> "Cfa":
        """The table seen after `top` rows and `left` columns are cut away."""
        height, width = self.period
        rows = self.rows[top % height :] + self.rows[: top % height]
        return Cfa(tuple(row[left % width :] + row[: left % width] for row in rows))

    def channels(self, height: int, width: int) -> Bytes:
        """Channel of every photosite, uint8 [height, width]."""
        return repeated(self.pattern, height, width)


Cfa.RGGB, Cfa.BGGR = Cfa.of("RG/GB"), Cfa.of("BG/GR")
Cfa.GRBG, Cfa.GBRG = Cfa.of("GR/BG"), Cfa.of("GB/RG")
Cfa.X_TRANS = Cfa.of("GBGGRG/RGRBGB/GBGGRG/GRGGBG/BGBRGR/GRGGBG")
Cfa.QUAD_BAYER = Cfa.of("RRGG/RRGG/GGBB/GGBB")
Cfa.KODAK_RGBW = Cfa.of("WBWG/BWGW/WGWR/GWRW")
Cfa.MONO = Cfa.of("W")
BAYER = (Cfa.RGGB, Cfa.BGGR, Cfa.GRBG, Cfa.GBRG)


def _repeats(sites: npt.NDArray[np.generic], length: int, axis: int) -> bool:
    return bool(np.array_equal(sites, np.roll(sites, length, axis)))


def repeated(tile: npt.NDArray[Site], height: int, width: int) -> npt.NDArray[Site]:
    """A tile [h, w] over all photosites, [height, width]."""
    rows, columns = tile.shape
    return np.tile(tile, (-(-height // rows), -(-width // columns)))[:height, :width]


def as_tile(values: npt.ArrayLike) -> Tile:
    """An array [h, w] as the nested tuples that records hold."""
    return tuple(tuple(float(value) for value in row) for row in np.atleast_2d(np.asarray(values)))


def rolled(tile: Tile, top: int, left: int) -> Tile:
    """The tile seen after `top` rows and `left` columns are cut away."""
    return as_tile(np.roll(np.array(tile), (-top, -left), axis=(0, 1)))


def mosaic(light: Floats, cfa: Cfa) -> Floats:
    """Keep of each pixel of `light` [H, W, channels] the one channel that `cfa` lets through: [H, W]."""
    channels = cfa.channels(*light.shape[:2])
    return np.take_along_axis(light, channels[..., None].astype(np.intp), axis=2)[..., 0]


def cell_means(image: npt.NDArray[np.generic], cfa: Cfa | None) -> Array32:
    """Mean of each channel over the cells of a mosaic [H, W]: float32 [H // cell, W // cell, channels].

    Rows and columns that complete no cell are left out. Without a CFA the image has its channels already.
    """
    if cfa is None:
        return np.asarray(image, np.float32)
    side, letters = cfa.cell, cfa.letters
    high, wide = image.shape[0] // side, image.shape[1] // side
    period = [lcm(side, length) for length in cfa.period]
    channels = repeated(cfa.pattern, *period)
    total = np.zeros((high, wide, len(letters)), np.float32)
    count = np.zeros((period[0] // side, period[1] // side, len(letters)), np.float32)
    for (row, column), channel in np.ndenumerate(channels):
        plane = image[row : high * side : period[0], column : wide * side : period[1]]
        total[row // side :: period[0] // side, column // side :: period[1] // side, channel] += plane
        count[row // side, column // side, channel] += 1
    for (row, column), _ in np.ndenumerate(count[..., 0]):
        total[row :: count.shape[0], column :: count.shape[1]] /= count[row, column]
    return total


def bilinear(image: Floats, cfa: Cfa, valid: Mask | None = None) -> tuple[Array32, Mask]:
    """Bilinear demosaic of a linear mosaic [H, W] -> light float32 [H, W, channels] and valid, bool.

    Each missing sample is the mean of its *valid* neighbours of the same channel, weighted by a tent that
    reaches one wherever the table is whole, so that a saturated or defect photosite does not spread. Where
    no neighbour is valid the value is 0 and `valid` is False. It blurs edges: `imaging.demosaicking` is for
    what somebody looks at or trains on.
    """
    height, width = image.shape
    channels = cfa.channels(height, width)
    trusted = np.ones(image.shape, bool) if valid is None else valid
    light = np.zeros((height, width, len(cfa.letters)), np.float32)
    known = np.zeros(light.shape, bool)
    for channel, weights in enumerate(tents(cfa)):
        sites = trusted & (channels == channel)
        weight = _around(sites, weights, cfa)
        total = _around(np.where(sites, image, 0.0), weights, cfa)
        known[..., channel] = weight > 0
        value = np.where(sites, image, total / np.maximum(weight, 1e-12))
        light[..., channel] = np.where(known[..., channel], value, 0.0)
    return light, known


def bilinear_variance(variance: Array, cfa: Cfa, valid: Mask) -> Array:
    """Variance [H, W, channels] of what `bilinear` makes of photosites of such a variance [H, W].

    Infinite next to a photosite whose own is, NaN where nothing is known.
    """
    from scipy import ndimage  # as cv2 below

    channels = cfa.channels(*variance.shape)
    planes = []
    for channel, weights in enumerate(tents(cfa)):
        known = valid & (channels == channel)
        weight = _around(known, weights, cfa)
        bound = ndimage.binary_dilation(known & ~np.isfinite(variance), np.ones(weights.shape, bool))
        spread = np.where(known & np.isfinite(variance), variance, 0.0).astype(np.float64)
        total = _around(spread, weights**2, cfa) / np.maximum(weight, 1e-12) ** 2
        plane = np.where(known, variance, np.where(bound, np.inf, total))
        planes.append(np.where(weight > 0, plane, np.nan))
    return np.stack(planes, axis=-1)


def _around(values: npt.NDArray[np.generic], weights: Array, cfa: Cfa) -> Array:
    """Weighted sums over the neighbours; beyond the edges the photosites of the last tile come again."""
    import cv2  # which takes a while to load, and most of what imports this does without

    reach, places = len(weights) // 2, []
    for length, period in zip(values.shape, cfa.period, strict=True):
        at = np.arange(-reach, length + reach)
        at = np.where(at < 0, at + lcm(period, 2), np.where(at >= length, at - lcm(period, 2), at))
        places.append(at.clip(0, length - 1))
    wide = values[np.ix_(*places)].astype(np.float64)
    filtered = cv2.filter2D(wide, -1, weights, borderType=cv2.BORDER_CONSTANT)  # the tents are symmetric
    return np.asarray(filtered[reach : len(filtered) - reach, reach : filtered.shape[1] - reach])


def tents(cfa: Cfa) -> Iterable[Array]:
    """Interpolation kernels: for each channel the narrowest tent, 1 at its middle, that reaches a photosite
    from everywhere.
    """
    from scipy import ndimage  # as cv2 above

    for channel in range(len(cfa.letters)):
        reach = 0
        while not ndimage.maximum_filter(cfa.pattern == channel, 2 * reach + 1, mode="wrap").all():
            reach += 1
        slope = 1.0 - np.abs(np.arange(-reach, reach + 1)) / (reach + 1.0)
        yield np.outer(slope, slope)

"""A picture of linear light, and where it lies in the window of a browser."""

from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from imaging.arrays import Array32, Bytes
from imaging.colour.spaces import srgb_decode

BESIDE = 24
"""Grey of what a window shows beside a picture of another shape."""
_BESIDE_LIGHT = float(srgb_decode(BESIDE / 255))
Picture = TypeVar("Picture", Bytes, Array32)
"""Codes, or light of which 1 is white."""


@dataclass(frozen=True)
class Frame:
    """light: linear, [H, W, 3]; aspect: width over height of the window, which shows all of it in its middle.

    window: width and height, px, of a window that shows it pixel for pixel instead; centre: the place of the
    picture, 0..1 from its upper left, in its middle.
    """

    light: Array32
    aspect: float
    window: tuple[int, int] | None = None
    centre: tuple[float, float] = (0.5, 0.5)

    def pixel(self, across: float, down: float) -> tuple[int, int] | None:
        """Row and column at a place in the window, 0..1 from its upper left; None beside the picture."""
        height, width = self.light.shape[:2]
        (wide, high), (left, top) = self._placed()
        column, row = int(np.floor(across * wide - left)), int(np.floor(down * high - top))
        return (row, column) if 0 <= row < height and 0 <= column < width else None

    def in_window(self, picture: Picture) -> Picture:
        """A picture of the frame's size, codes or light, as the window shows it, with what is beside it."""
        height, width = self.light.shape[:2]
        (wide, high), (left, top) = self._placed()
        if (wide, high, left, top) == (width, height, 0, 0):
            return picture
        shown = np.full(
            (high, wide, 3), BESIDE if picture.dtype == np.uint8 else _BESIDE_LIGHT, picture.dtype
        )
        inside = picture[max(0, -top) : max(0, high - top), max(0, -left) : max(0, wide - left)]
        top, left = max(0, top), max(0, left)
        shown[top : top + inside.shape[0], left : left + inside.shape[1]] = inside
        return shown

    def _placed(self) -> tuple[tuple[int, int], tuple[int, int]]:
        """Width and height of the window, and where the picture's upper left corner lies in it, px."""
        height, width = self.light.shape[:2]
        if self.window is not None:
            (wide, high), (across, down) = self.window, self.centre
            return self.window, (wide // 2 - int(across * width), high // 2 - int(down * height))
        left = max(0, round((height * self.aspect - width) / 2))
        top = max(0, round((width / self.aspect - height) / 2))
        return (width + 2 * left, height + 2 * top), (left, top)


def marked(picture: Picture, across: float, down: float) -> Picture:
    """Draw a ring around a place of a picture, 0..1 from its upper left, that is seen on any colour."""
    height, width = picture.shape[:2]
    radius = max(3.0, width / 160)
    reach = int(radius) + 3
    column, row = across * width, down * height
    left, top = max(0, int(column) - reach), max(0, int(row) - reach)
    shown = picture.copy()
    near = shown[top : int(row) + reach, left : int(column) + reach]
    rows, columns = np.ogrid[: near.shape[0], : near.shape[1]]
    away = np.hypot(rows + top + 0.5 - row, columns + left + 0.5 - column)
    near[np.abs(away - radius) < 1.5] = 0
    near[np.abs(away - radius) < 0.75] = 255 if picture.dtype == np.uint8 else 1
    return shown

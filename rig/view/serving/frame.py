"""A picture of linear light, and where it lies in the window of a browser."""

from dataclasses import dataclass

import numpy as np

from imaging.arrays import Array32, Bytes

BESIDE = 24
"""Grey of what a window shows beside a picture of another shape."""


@dataclass(frozen=True)
class Frame:
    """light: linear, [H, W, 3]; aspect: width over height of the window, which shows it in its middle."""

    light: Array32
    aspect: float

    def pixel(self, across: float, down: float) -> tuple[int, int] | None:
        """Row and column at a place in the window, 0..1 from its upper left; None beside the picture."""
        height, width = self.light.shape[:2]
        left, top = self._beside()
        column = int(np.floor(across * (width + 2 * left) - left))
        row = int(np.floor(down * (height + 2 * top) - top))
        return (row, column) if 0 <= row < height and 0 <= column < width else None

    def in_window(self, picture: Bytes) -> Bytes:
        """A picture of the frame's size with what is beside it, of the window's shape."""
        left, top = self._beside()
        if not left and not top:
            return picture
        return np.pad(picture, ((top, top), (left, left), (0, 0)), constant_values=BESIDE)

    def _beside(self) -> tuple[int, int]:
        """Pixels on either side, and above and below."""
        height, width = self.light.shape[:2]
        return max(0, round((height * self.aspect - width) / 2)), max(
            0, round((width / self.aspect - height) / 2)
        )


def marked(picture: Bytes, across: float, down: float) -> Bytes:
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
    near[np.abs(away - radius) < 0.75] = 255
    return shown

"""A picture of linear light, and where it lies in the window of a browser."""

from dataclasses import dataclass

import numpy as np

from rig.view.pictures.tones import Light, Picture

BESIDE = 24
"""Grey of what a window shows beside a picture of another shape."""


@dataclass(frozen=True)
class Frame:
    """light: linear, [H, W, 3]; aspect: width over height of the window, which shows it in its middle."""

    light: Light
    aspect: float

    def pixel(self, across: float, down: float) -> tuple[int, int] | None:
        """Row and column at a place in the window, 0..1 from its upper left; None beside the picture."""
        height, width = self.light.shape[:2]
        left, top = self._beside()
        column = int(np.floor(across * (width + 2 * left) - left))
        row = int(np.floor(down * (height + 2 * top) - top))
        return (row, column) if 0 <= row < height and 0 <= column < width else None

    def in_window(self, picture: Picture) -> Picture:
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

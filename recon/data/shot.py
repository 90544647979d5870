"""One exposure as training sees it: its numbers, wherever they are kept, and what is known of them."""

import math
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from imaging.arrays import Array32, Mask
from imaging.merge.linear_frame import (
    DARK_CODE,
    SATURATED_CODE,
    CodeSignalNoise,
    LinearFrame,
    Noise,
    SensorSignalNoise,
    decode,
)
from imaging.sensor.cfa import Cfa
from imaging.session.calibration import Response

ABOVE = 3.0
"""Standard deviations by which a signal is above its noise."""


class Planes(Protocol):
    """The numbers of a shot, as `Shot` describes them.

    transparent: whether there is alpha. held: whether they are in memory as long as the shot is; else every
    look at them reads them anew.
    """

    @property
    def pixels(self) -> Array32: ...  # noqa: D102
    @property
    def saturated(self) -> Mask: ...  # noqa: D102
    @property
    def dark(self) -> Mask: ...  # noqa: D102
    @property
    def valid(self) -> Mask: ...  # noqa: D102
    @property
    def alpha(self) -> Array32 | None: ...  # noqa: D102
    @property
    def shape(self) -> tuple[int, ...]: ...  # noqa: D102
    @property
    def transparent(self) -> bool: ...  # noqa: D102
    @property
    def held(self) -> bool: ...  # noqa: D102


@dataclass(frozen=True, eq=False)
class HeldPlanes:
    """Planes in memory.

    held: for as long as the shot is; else they were made for one look.
    """

    pixels: Array32
    saturated: Mask
    dark: Mask
    valid: Mask
    alpha: Array32 | None = None
    held: bool = True

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the pixels."""
        return self.pixels.shape

    @property
    def transparent(self) -> bool:
        """True if it has alpha."""
        return self.alpha is not None


@dataclass(frozen=True, eq=False)
class Shot:
    """Exposure of a view.

    k: exposure scale, s. pixels: float32 [H, W] (mosaic) or [H, W, 3]: linear signal with white at 1 (RAW;
    noise below black stays negative), code values 0..1 (LDR), or linear light (HDR). saturated: bool, same
    shape: the scene is at least this bright. dark: bool, the scene is at most this bright (LDR only). valid:
    bool, same shape; False where the file holds no number. A mask that is the same everywhere is read-only.
    alpha: float32 [H, W], alpha of a photograph, 0..1; None: opaque or unknown. Each access of these may read
    a file: take them once. noise: of the linear signal; None if unknown. ceiling: the signal at which the
    sensor saturates (RAW only), as it was measured, else that of the file's white level. band: the channel of
    the scene's light that it shows, of a mono camera behind a filter; None: all of them, as its camera sees
    Rec.709.
    """

    file: str
    k: float
    planes: Planes
    noise: Noise | None = None
    ceiling: float | None = None
    band: int | None = None

    @property
    def pixels(self) -> Array32:
        """The signal."""
        return self.planes.pixels

    @property
    def saturated(self) -> Mask:
        """Mask of saturated pixels; there the signal is a lower bound."""
        return self.planes.saturated

    @property
    def dark(self) -> Mask:
        """Mask of dark pixels; there the signal is an upper bound."""
        return self.planes.dark

    @property
    def valid(self) -> Mask:
        """Mask of pixels with data."""
        return self.planes.valid

    @property
    def alpha(self) -> Array32 | None:
        """Share of the light that comes from the scene."""
        return self.planes.alpha

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the pixels."""
        return self.planes.shape

    @property
    def top(self) -> float:
        """Saturation level of the signal: the ceiling of RAW, the last code of a photograph."""
        return 1.0 if self.ceiling is None else self.ceiling

    def showing(self, **planes: Any) -> "Shot":
        """The same in memory, with other planes, by name."""
        names = ("pixels", "saturated", "dark", "valid", "alpha")
        return replace(self, planes=HeldPlanes(**{name: getattr(self, name) for name in names} | planes))

    def linear(self, response: Response | None, cfa: Cfa | None) -> LinearFrame:
        """The shot as linear light; codes are decoded by `response` (None: they are linear already)."""
        signal = self.pixels if response is None else decode(self.pixels, response)
        return LinearFrame(
            signal, self.k, self.saturated, self.dark, self.valid, cfa, self.noise, self.ceiling
        )


def measured_light(shot: Shot, response: Response) -> tuple[float, float] | None:
    """Least and most linear radiance, of something grey, that a shot measures above its noise and below
    white.

    By `ABOVE` standard deviations of a photosite, or of a code value; vignetting and colour filters are not
    counted. None if the limits are unknown, as of EXR.
    """
    if isinstance(shot.noise, SensorSignalNoise):
        slope, floor = ABOVE**2 * shot.noise.slope, ABOVE**2 * shot.noise.floor
        return (slope + math.sqrt(slope**2 + 4 * floor)) / (2 * shot.k), shot.top / shot.k
    if isinstance(shot.noise, CodeSignalNoise):
        codes = np.linspace(DARK_CODE, SATURATED_CODE, 254)
        light = decode(np.repeat(codes[:, None], 3, axis=1), response)
        above = light > ABOVE * np.sqrt(shot.noise.variance(light))
        least = light[int(above[:, 1].argmax()), 1] if above[:, 1].any() else light[-1, 1]
        return float(least) / shot.k, float(light[-1, 1]) / shot.k
    return None if shot.ceiling is None else (0.0, shot.ceiling / shot.k)


def bytes_of(plane: Array32 | Mask) -> int:
    """Bytes of a plane in memory; none of one that says everywhere the same."""
    return plane.nbytes if any(plane.strides) else 0

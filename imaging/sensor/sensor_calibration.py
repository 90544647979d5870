"""Sensor measurements at one ISO: the record in calibration.json, and how frames are read with it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from pydantic import Field

from imaging.arrays import Array32, Mask
from imaging.record import Record
from imaging.sensor.cfa import Tile
from imaging.sensor.noise import SensorNoise


class Measured(Record):
    """A value and its standard error, both in the unit of the field that holds it."""

    value: float
    sigma: float = Field(ge=0)
    source: Literal["darks", "flats", "darks and flats", "brackets"]


class Defect(Record):
    """A photosite that cannot be trusted, by column and row of the mosaic.

    hot: brighter in the dark than noise and fixed pattern explain; dead: answers light otherwise than
    its neighbours; noisy: noisier than they are.
    """

    x: int = Field(ge=0)
    y: int = Field(ge=0)
    kind: Literal["hot", "dead", "noisy"]


class SensorCalibration(Record):
    """Measurements of one sensor at one ISO (EMVA 1288 terms); None for what could not be determined."""

    iso: float | None = None
    """ISO speed; None if the files do not state it."""
    black: tuple[tuple[Measured, ...], ...] | None = None
    """DN of the sites of a tile that repeats, row by row: 2x2 of Bayer and mono, 6x6 of X-Trans."""
    gain: Measured | None = None
    """K, DN per electron."""
    read_noise: Measured | None = None
    """Electrons, of single photosites."""
    row_noise: Measured | None = None
    """Electrons, common to the photosites of a row."""
    prnu: Measured | None = None
    """Photo-response non-uniformity, relative."""
    dsnu: Measured | None = None
    """Dark signal non-uniformity, electrons, at the shortest time of the darks."""
    dark_current: Measured | None = None
    """Electrons/s, mean."""
    ceiling: Measured | None = None
    """DN at which photosites saturate; sigma is the scatter of saturated ones, rounding included."""
    full_well: Measured | None = None
    """Electrons between black and the ceiling (saturation capacity)."""
    nonlinearity: Measured | None = None
    """Share of the signal that is missing at white: `signal = light (1 - nonlinearity light)`."""
    linear: bool | None = None
    """True if the response is a straight line within the error of the data; None if untested."""
    defects: tuple[Defect, ...] | None = None
    """Defective photosites; None if not searched."""
    transfer: tuple[tuple[float, float], ...] = ()
    """Points of the photon transfer curve, where darks and flats gave some: mean above black, DN, and
    variance in time, DN^2."""

    def noise(self) -> SensorNoise | None:
        """The noise model of a photosite, row noise included; None without gain or read noise."""
        if self.gain is None or self.read_noise is None:
            return None
        row = 0.0 if self.row_noise is None else self.row_noise.value
        return SensorNoise(
            gain=self.gain.value,
            read_noise=float(np.hypot(self.read_noise.value, row)),
            prnu=0.0 if self.prnu is None else self.prnu.value,
        )

    def levels(self) -> "Levels":
        """Return what reading a file needs of this."""
        black = None
        if self.black is not None:
            black = tuple(tuple(level.value for level in row) for row in self.black)
        # A photosite within the scatter of the ceiling may be saturated.
        white = None if self.ceiling is None else int(np.ceil(self.ceiling.value - 3 * self.ceiling.sigma))
        bend = self.nonlinearity.value if self.linear is False and self.nonlinearity is not None else 0.0
        return Levels(black, white, self.noise(), tuple((d.x, d.y) for d in self.defects or ()), bend)


@dataclass(frozen=True)
class Levels:
    """Measured levels of a RAW file, in place of those it states; None: as stated.

    black: DN of the sites of a tile; white: DN at and above which a photosite counts as saturated; noise: of
    the photosites; defects: column and row of photosites that hold no number; bend: share of the signal that
    is missing at white, 0 where the response is as straight as the data can show.
    """

    black: Tile | None = None
    white: int | None = None
    noise: SensorNoise | None = None
    defects: tuple[tuple[int, int], ...] = ()
    bend: float = 0.0

    def straight(self, signal: Array32) -> Array32:
        """Linearise a signal relative to white; the inverse of `x (1 - bend x)`."""
        if self.bend == 0.0:
            return signal
        # Beyond the parabola's top no light has that signal; no sensor bends that far below white.
        root = np.sqrt(np.maximum(1.0 - 4.0 * self.bend * signal.astype(np.float64), 0.0))
        return np.asarray(2.0 * signal / (1.0 + root), np.float32)

    def valid(self, height: int, width: int) -> Mask:
        """False at the defects, bool [H, W]."""
        mask = np.ones((height, width), bool)
        if self.defects:
            columns, rows = np.array(self.defects).T
            inside = (columns < width) & (rows < height)
            mask[rows[inside], columns[inside]] = False
        return mask


def at_iso(sensors: Sequence[SensorCalibration], iso: float | None) -> SensorCalibration | None:
    """The calibration at an ISO, or None: another ISO's is never substituted."""
    return next((sensor for sensor in sensors if sensor.iso == iso), None)

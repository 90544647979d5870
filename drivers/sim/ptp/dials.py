"""Shutter, aperture and ISO as the makers number them.

A dial is a property and its positions: the number that the property holds and its label,
in seconds, as an f-number, or as an ISO speed. A camera offers the positions that the sensor behind it has.
Sources: libgphoto2 for the codes of the makers; what real cameras answer in its dumps.
"""

from dataclasses import dataclass, replace
from typing import Literal

from drivers.ptp.protocol.codes import CanonProperty, DataType, NikonProperty, PropertyCode, SonyProperty
from drivers.sim.camera import shutter

Setting = Literal["time", "f_number", "iso"]

TIMES = tuple(sorted(shutter.APPLIED_TIME))
F_NUMBERS = tuple(sorted(shutter.APPLIED_F_NUMBER))


@dataclass(frozen=True)
class SimulatedDial:
    """A property that shows an exposure setting. positions: (number, label), by label ascending."""

    setting: Setting
    code: int
    data_type: DataType
    positions: tuple[tuple[int, float], ...]

    def offering(self, labels: tuple[float, ...]) -> "SimulatedDial":
        """The dial with those of its positions whose labels are given."""
        return replace(
            self, positions=tuple(position for position in self.positions if position[1] in labels)
        )

    def number(self, label: float) -> int:
        """Return what the property holds at a label, or at the one nearest to it."""
        return min(self.positions, key=lambda position: max(position[1] / label, label / position[1]))[0]

    def label(self, number: int) -> float | None:
        """Return the label of a number, the shortest time if it has several; None if it is no position."""
        return next((label for value, label in self.positions if value == number), None)

    def numbers(self) -> tuple[int, ...]:
        """Every number that the property takes, each once, by label ascending."""
        return tuple(dict.fromkeys(number for number, _ in self.positions))


# How Nikons write the times that are no 1/n: the D780 and the Z 6 of the dumps agree.
_NIKON_SLOW = {
    **{0.3: (1, 3), 0.4: (10, 25), 0.5: (1, 2), 0.6: (10, 16), 0.8: (10, 13)},
    **{1.3: (13, 10), 1.6: (16, 10), 2.5: (25, 10), 3.2: (3, 1)},
}


def _nikon(time: float) -> tuple[int, int]:
    return _NIKON_SLOW.get(time) or ((round(time), 1) if time >= 1.0 else (1, round(1 / time)))


def _packed(time: float) -> int:
    numerator, denominator = _nikon(time)
    return numerator << 16 | denominator


def _tenths(time: float) -> int:
    """Format as Sony does: 1/250, but 4/10, 13/10 and 300/10."""
    if 1 / time > 2.5:
        return 1 << 16 | round(1 / time)
    return round(10 * time) << 16 | 10


def _apex(base: int, stops: float) -> int:
    """Canon's eighths of a stop; thirds are rounded to the nearest."""
    return base + round(8 * stops)


# Truncated, as the Nikons of the dumps do: 1/640 s is 15 and both 1/8000 and 1/6400 s are 1.
_TENTHS_OF_MILLISECONDS = tuple(
    (10_000 * numerator // denominator, time) for time in TIMES for numerator, denominator in (_nikon(time),)
)

EXPOSURE_TIME = SimulatedDial("time", PropertyCode.EXPOSURE_TIME, DataType.UINT32, _TENTHS_OF_MILLISECONDS)
F_NUMBER = SimulatedDial(
    "f_number",
    PropertyCode.F_NUMBER,
    DataType.UINT16,
    tuple((round(100 * f_number), f_number) for f_number in F_NUMBERS),
)
EXPOSURE_INDEX = SimulatedDial(
    "iso", PropertyCode.EXPOSURE_INDEX, DataType.UINT16, tuple((int(iso), iso) for iso in shutter.ISOS)
)
NIKON_TIME = SimulatedDial(
    "time", NikonProperty.SHUTTER_SPEED, DataType.UINT32, tuple((_packed(time), time) for time in TIMES)
)
NIKON_ISO = replace(EXPOSURE_INDEX, code=NikonProperty.ISO_EX, data_type=DataType.UINT32)
SONY_TIME = SimulatedDial(
    "time", SonyProperty.SHUTTER_SPEED, DataType.UINT32, tuple((_tenths(time), time) for time in TIMES)
)
SONY_ISO = replace(EXPOSURE_INDEX, code=SonyProperty.ISO, data_type=DataType.UINT32)
CANON_TIME = SimulatedDial(
    "time",
    CanonProperty.SHUTTER_SPEED,
    DataType.UINT16,
    tuple((_apex(0x10, (len(TIMES) - 1 - index) / 3), time) for index, time in enumerate(TIMES)),
)
CANON_F_NUMBER = SimulatedDial(
    "f_number",
    CanonProperty.APERTURE,
    DataType.UINT16,
    tuple((_apex(0x20, index), f_number) for index, f_number in enumerate(F_NUMBERS)),
)
CANON_ISO = SimulatedDial(
    "iso",
    CanonProperty.ISO_SPEED,
    DataType.UINT16,
    tuple((_apex(0x48, index), iso) for index, iso in enumerate(shutter.ISOS)),
)

"""The dials of a camera: the labels that it shows and the values that it applies.

Cameras name shutter times and apertures by round numbers and apply powers of two: "1/60" is 1/64 s,
"5.6" is 4 sqrt(2).
"""

from collections.abc import Sequence

from imaging.optics.dial_settings import F_NUMBERS, SHUTTER_TIMES
from imaging.optics.exposure import Exposure

APPLIED_TIME = SHUTTER_TIMES
"""Seconds that the shutter stays open, by label in seconds: 30 s is 32 s, 1/8000 is 2^-13 s."""

APPLIED_F_NUMBER = {label: F_NUMBERS[label] for label in (2.8, 4.0, 5.6, 8.0, 11.0, 16.0)}
"""f-number that the iris takes, by label."""

ISOS = (100.0, 200.0, 400.0, 800.0, 1600.0)


def _nearest(values: Sequence[float], wanted: float) -> float:
    return min(values, key=lambda value: max(value / wanted, wanted / value))


def snap(exposure: Exposure) -> Exposure:
    """The nearest exposure on the dials, as labels; what is out of range goes to the nearest end.

    An f-number or ISO that is not given is f/4 and ISO 100, where the dials rest.
    """
    return Exposure(
        time=_nearest(tuple(APPLIED_TIME), exposure.time),
        f_number=_nearest(tuple(APPLIED_F_NUMBER), exposure.f_number or 4.0),
        iso=_nearest(ISOS, exposure.iso or 100.0),
    )


def applied(label: Exposure) -> Exposure:
    """Return what the camera does when its dials show `label`, which must come from `snap`."""
    assert label.f_number is not None
    return Exposure(time=APPLIED_TIME[label.time], f_number=APPLIED_F_NUMBER[label.f_number], iso=label.iso)

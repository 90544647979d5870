"""The dials of a camera: the labels that it shows and the values that it applies.

Cameras name shutter times and apertures by round numbers and apply powers of two: "1/60" is 1/64 s,
"5.6" is 4 sqrt(2).
"""

from collections.abc import Sequence

from imaging.exposure import Exposure

_SLOW = (30, 25, 20, 15, 13, 10, 8, 6, 5, 4, 3.2, 2.5, 2, 1.6, 1.3, 1, 0.8, 0.6, 0.5, 0.4, 0.3)
_FAST = (4, 5, 6, 8, 10, 13, 15, 20, 25, 30, 40, 50, 60, 80, 100, 125, 160, 200, 250, 320, 400, 500, 640)
_FASTEST = (800, 1000, 1250, 1600, 2000, 2500, 3200, 4000, 5000, 6400, 8000)
_LABELS = (*map(float, _SLOW), *(1.0 / value for value in _FAST + _FASTEST))

APPLIED_TIME = {label: 2.0 ** ((15 - index) / 3) for index, label in enumerate(_LABELS)}
"""Seconds that the shutter stays open, by label in seconds: 30 s is 32 s, 1/8000 is 2^-13 s."""

APPLIED_F_NUMBER = {2.8: 8.0**0.5, 4.0: 4.0, 5.6: 32.0**0.5, 8.0: 8.0, 11.0: 128.0**0.5, 16.0: 16.0}
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
    """What the camera does when its dials show `label`, which must come from `snap`."""
    assert label.f_number is not None
    return Exposure(time=APPLIED_TIME[label.time], f_number=APPLIED_F_NUMBER[label.f_number], iso=label.iso)

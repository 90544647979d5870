"""What a still camera does when its dials show round numbers: powers of two, in thirds of a stop."""

from collections.abc import Iterable

from imaging.exposure import Exposure

_SLOW = (30, 25, 20, 15, 13, 10, 8, 6, 5, 4, 3.2, 2.5, 2, 1.6, 1.3, 1, 0.8, 0.6, 0.5, 0.4, 0.3)
_FAST = (4, 5, 6, 8, 10, 13, 15, 20, 25, 30, 40, 50, 60, 80, 100, 125, 160, 200, 250, 320, 400, 500)
_FASTEST = (640, 800, 1000, 1250, 1600, 2000, 2500, 3200, 4000, 5000, 6400, 8000)
_TIMES = {
    name: 2.0 ** ((15 - index) / 3)
    for index, name in enumerate((*map(float, _SLOW), *(1 / value for value in _FAST + _FASTEST)))
}
"""Seconds, by the name of a shutter time in seconds: 1/60 is 1/64 s."""

_WIDE = (1.0, 1.1, 1.2, 1.4, 1.6, 1.8, 2.0, 2.2, 2.5, 2.8, 3.2, 3.5, 4.0, 4.5, 5.0, 5.6, 6.3, 7.1)
_NARROW = (8.0, 9.0, 10.0, 11.0, 13.0, 14.0, 16.0, 18.0, 20.0, 22.0, 25.0, 29.0, 32.0)
_F_NUMBERS = {name: 2.0 ** (index / 6) for index, name in enumerate(_WIDE + _NARROW)}
"""f-number by its name: 5.6 is 4 sqrt(2), 11 is 8 sqrt(2)."""


def meant(exposures: Iterable[Exposure]) -> dict[Exposure, Exposure]:
    """What each exposure stands for, round names of times and f-numbers taken for their powers of two.

    Times are taken so only if all of them are names of the standard series, and so are f-numbers: a
    camera that states others, as a phone or an industrial camera does, means them as they are. ISO stays
    as it is.
    """
    given = set(exposures)
    times = _exact((one.time for one in given), _TIMES)
    apertures = _exact((one.f_number for one in given if one.f_number is not None), _F_NUMBERS)
    return {
        one: Exposure(
            time=times[one.time],
            f_number=None if one.f_number is None else apertures[one.f_number],
            iso=one.iso,
        )
        for one in given
    }


def _exact(labels: Iterable[float], series: dict[float, float]) -> dict[float, float]:
    found, labels = {}, list(labels)
    for label in labels:
        name = min(series, key=lambda value: abs(value / label - 1))
        if abs(name / label - 1) > 2e-3:
            return {each: each for each in labels}
        found[label] = series[name]
    return found

"""Nominal dial settings of still cameras: powers of two, in thirds of a stop."""

from collections.abc import Iterable
from fractions import Fraction

from imaging.optics.exposure import Exposure


def labels(row: str) -> tuple[str, ...]:
    """The marks of a dial, from one row of text."""
    return tuple(row.split())


SHUTTER_LABELS = labels(
    "30 25 20 15 13 10 8 6 5 4 3.2 2.5 2 1.6 1.3 1 0.8 0.6 0.5 0.4 0.3 1/4 1/5 1/6 1/8 1/10 1/13 1/15 1/20 "
    "1/25 1/30 1/40 1/50 1/60 1/80 1/100 1/125 1/160 1/200 1/250 1/320 1/400 1/500 1/640 1/800 1/1000 1/1250 "
    "1/1600 1/2000 1/2500 1/3200 1/4000 1/5000 1/6400 1/8000"
)
"""The marks of a shutter dial in seconds, longest first: a third of a stop lies between two of them."""
SHUTTER_TIMES = {
    float(Fraction(label)): 2.0 ** ((15 - index) / 3) for index, label in enumerate(SHUTTER_LABELS)
}
"""Seconds that the shutter stays open, by its mark: 1/60 is 1/64 s, 30 is 32 s."""
_OTHER_MARKS = {
    float(Fraction(label)): 2.0 ** (thirds / 3)
    for thirds, marks in {
        5: "3",
        -1: "10/13",
        -2: "10/16",
        -5: "1/3",
        -40: "1/10000",
        -41: "1/12500 1/12800 1/13000",
        -42: "1/16000",
        -43: "1/20000",
        -44: "1/25000 1/25600",
        -45: "1/32000",
    }.items()
    for label in labels(marks)
}
"""The same for marks of some dials only: other names of times of the series, and electronic shutters."""

_WIDE = (1.0, 1.1, 1.2, 1.4, 1.6, 1.8, 2.0, 2.2, 2.5, 2.8, 3.2, 3.5, 4.0, 4.5, 5.0, 5.6, 6.3, 7.1)
_NARROW = (8.0, 9.0, 10.0, 11.0, 13.0, 14.0, 16.0, 18.0, 20.0, 22.0, 25.0, 29.0, 32.0)
F_NUMBERS = {name: 2.0 ** (index / 6) for index, name in enumerate(_WIDE + _NARROW)}
"""f-number of the iris by its mark: 5.6 is 4 sqrt(2), 11 is 8 sqrt(2)."""


def meant(exposures: Iterable[Exposure]) -> dict[Exposure, Exposure]:
    """Return the exact setting behind each rounded one: nominal times and f-numbers become their powers of
    two.

    Times are taken so only if all of them are marks of shutter dials, and f-numbers if all are of irises: a
    camera that states others, as a phone or an industrial camera does, means them as they are. ISO stays
    as it is.
    """
    given = set(exposures)
    times = _exact((one.time for one in given), SHUTTER_TIMES | _OTHER_MARKS)
    apertures = _exact((one.f_number for one in given if one.f_number is not None), F_NUMBERS)
    return {
        one: Exposure(
            time=times[one.time],
            f_number=None if one.f_number is None else apertures[one.f_number],
            iso=one.iso,
        )
        for one in given
    }


def _exact(labels: Iterable[float], series: dict[float, float]) -> dict[float, float]:
    exact, labels = {}, list(labels)
    for label in labels:
        name = min(series, key=lambda value: abs(value / label - 1))
        if abs(name / label - 1) > 2e-3:
            return {each: each for each in labels}
        exact[label] = series[name]
    return exact

"""Names of a body's settings in libgphoto2, and its choices as numbers.

The names are those of libgphoto2's `camlibs/ptp2/config.c`; a choice is text that differs from make to make:
`1/250`, `0.0040s`, `13/10`, `30s`, `1/2.5s`, `2m`, `f/2.8`, `Auto`. Of its translations, some write a decimal
comma, a space before the unit, or a unit in their own script.
"""

import re
from collections.abc import Callable
from fractions import Fraction

from drivers.ptp.shutter import TICKS

TIMES = ("shutterspeed2", "shutterspeed", "exptime")
"""Settings of the exposure time, the most exact first: Nikon's `shutterspeed` is rounded to 100 us."""
F_NUMBERS = ("aperture", "f-number")
ISOS = ("iso",)

Decode = Callable[[str], float | None]

_INCHES = ('"', "″", "”", "''")
_SECONDS = (
    *("", "s", "sec", "secs", "second", "seconds", "sek", "sekunde", "sekunden", "seconde", "secondes"),
    *("seg", "segundo", "segundos", "secondo", "secondi", "gy", "с", "сек", "ث", "წმ", "秒", "초", *_INCHES),
)
"""Words for seconds, as libgphoto2's translations and cameras themselves write them."""
_UNITS: dict[str, float] = {
    **dict.fromkeys(_SECONDS, 1.0),
    **dict.fromkeys(("m", "min", "mins", "minute", "minutes"), 60.0),
    **dict.fromkeys(("ms", "msec", "мс", "毫秒"), 1e-3),
    **dict.fromkeys(("us", "µs", "μs", "usec"), 1e-6),
}
"""Seconds of each."""
_NUMBER = r"\d+(?:[.,]\d+)?"
_GROUPED = r"\d{1,3}(?:[ .,'’]\d{3})+(?!\d)"
_TIME = re.compile(
    rf"(?:(?P<whole>\d+) (?=\d+ ?/))?(?P<over>{_NUMBER})"
    rf"(?: ?/ ?(?P<under>{_GROUPED}|{_NUMBER}))? ?(?P<unit>[^\d\s]*)(?P<tail>(?<=\D)\d+)?"
)
_F_NUMBER = re.compile(rf"(?:[fFƒ] ?[/:]? ?)?(?P<number>{_NUMBER})")
_ISO = re.compile(
    rf"(?:ISO ?)?(?P<number>{_GROUPED}|{_NUMBER})(?: ?/ ?\d+ ?°)?(?: ?ISO)?", re.IGNORECASE | re.ASCII
)
_THOUSANDS = re.compile(r"[ .,'’](?=\d{3}(?!\d))")
_TICKS = re.compile(r"\d+\.\d{4}")


def seconds(choice: str) -> float | None:
    """Read an exposure time in seconds; None for bulb, automatic and anything else.

    Without a unit it is seconds. Four decimals and a unit, as `0.0001s`, are ticks of 100 us, that cut off or
    round what the dial has: they stand for the mark nearest.
    """
    match = _TIME.fullmatch(_spaced(choice))
    if match is None:
        return None
    unit = _UNITS.get(match["unit"].lower().rstrip("."))
    if match["tail"]:  # as a camera's own dial has it: 0"4
        number, unit = f"{match['over']}.{match['tail']}", 1.0 if match["unit"] in _INCHES else None
    elif match["under"]:
        number = f"{_decimal(match['over'])}/{_decimal(_THOUSANDS.sub('', match['under']))}"
    else:
        number = _decimal(match["over"])
    value = _positive(number)
    if value is None or unit is None:
        return None
    if match["unit"] and unit == 1.0 and _TICKS.fullmatch(number):
        return TICKS.decode(round(1e4 * value))
    return (value + int(match["whole"] or 0)) * unit


def f_number(choice: str) -> float | None:
    """Read the f-number of `f/2.8`, `F2.8`, `f/2,8` or `2.8`; None for any other text."""
    match = _F_NUMBER.fullmatch(_spaced(choice))
    return None if match is None else _positive(_decimal(match["number"]))


def iso(choice: str) -> float | None:
    """Read the speed of `100`, `ISO 100`, `ISO 100/21°` or `12,800`; None for any other text.

    That is automatic, with or without an end of its range, a setting beyond the scale (`Lo 1`), and one in
    which the camera makes a picture of several.
    """
    match = _ISO.fullmatch(_spaced(choice))
    return None if match is None else _positive(_decimal(_THOUSANDS.sub("", match["number"])))


def _spaced(text: str) -> str:
    """The text with single spaces of one kind."""
    return " ".join(text.split())


def _decimal(number: str) -> str:
    return number.replace(",", ".")


def _positive(number: str) -> float | None:
    """The value of a positive decimal number, or of a quotient of two."""
    over, _, under = number.partition("/")
    try:
        value = float(Fraction(over) / Fraction(under or 1))
    except (ValueError, ZeroDivisionError, OverflowError):
        return None
    return value if value > 0 else None


def choices(listed: list[str], decode: Decode) -> dict[str, float]:
    """The choices that are numbers, ascending; of those that mean the same the first."""
    texts: dict[float, str] = {}
    for text in listed:
        value = decode(text)
        if value is not None:
            texts.setdefault(value, text)
    return {texts[value]: value for value in sorted(texts)}

"""What libgphoto2 calls the settings of a body, and its choices as numbers.

The names are those of libgphoto2's `camlibs/ptp2/config.c`; a choice is text that differs from make to make:
`1/250`, `0.0040s`, `13/10`, `f/2.8`, `Auto`.
"""

from collections.abc import Callable
from fractions import Fraction

from drivers.ptp.shutter import TICKS

TIMES = ("shutterspeed2", "shutterspeed", "exptime")
"""Settings of the exposure time, the most exact first: Nikon's `shutterspeed` is rounded to 100 us."""
F_NUMBERS = ("aperture", "f-number")
ISOS = ("iso",)
FORMATS = ("imageformat", "imagequality")
"""What a body saves."""
_RAW_WORDS = ("raw", "nef", "arw", "cr2", "cr3", "crw", "dng", "orf", "raf", "rw2", "pef")

Decode = Callable[[str], float | None]


def seconds(choice: str) -> float | None:
    """The exposure time; None for bulb, automatic and what is no number.

    `0.0001s` is of 100 us ticks, that cut off or round what the dial has: it stands for the mark nearest.
    """
    if choice.endswith("s") and "." in choice:
        ticks = number(choice[:-1])
        return None if ticks is None else TICKS.decode(round(1e4 * ticks))
    return number(choice)


def f_number(choice: str) -> float | None:
    """The f-number of `f/2.8`, `F2.8` or `2.8`."""
    return number(choice.lower().removeprefix("f").removeprefix("/"))


def number(choice: str) -> float | None:
    """A positive number, whole, decimal or a quotient; None for any other text."""
    try:
        value = float(Fraction(choice.strip())) if "/" not in choice else _quotient(choice)
    except (ValueError, ZeroDivisionError, OverflowError):
        return None
    return value if value > 0 else None


def _quotient(choice: str) -> float:
    over, _, under = choice.partition("/")
    return float(Fraction(over.strip()) / Fraction(under.strip()))


def choices(listed: list[str], decode: Decode) -> dict[str, float]:
    """The choices that are numbers, ascending; of those that mean the same the first."""
    found: dict[float, str] = {}
    for text in listed:
        value = decode(text)
        if value is not None:
            found.setdefault(value, text)
    return {found[value]: value for value in sorted(found)}


def says_raw(text: str) -> bool:
    """Whether a format has a RAW file, alone or beside a photograph."""
    return any(word in text.lower() for word in _RAW_WORDS)


def says_both(text: str) -> bool:
    """Whether it has a photograph beside the RAW file."""
    return says_raw(text) and "+" in text


def plain_raw(listed: list[str]) -> str | None:
    """The format that is a RAW file and nothing else, the largest where there are several."""
    found = [text for text in listed if says_raw(text) and "+" not in text]
    return next((text for text in found if text.lower() in ("raw", "nef (raw)")), next(iter(found), None))

"""Exposure times as cameras number them, as data: what a code means in seconds, and how sure that is.

Sources: libgphoto2's codes, and the lists that real bodies sent (its dumps). A table's times are the nominal
ones, as on the dial.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache

from imaging.optics.dial_settings import SHUTTER_LABELS, labels

_HALVES = labels("20 10 6 3 1.5 0.7 0.3 1/6 1/10 1/20 1/45 1/90 1/180 1/350 1/750 1/1500 1/3000 1/6000")
_ELECTRONIC = labels("1/10000 1/13000 1/16000 1/20000 1/25000 1/32000")

THIRD_STOPS = tuple(Fraction(label) for label in SHUTTER_LABELS)
"""Seconds, from 30 to 1/8000, as on the dials of cameras."""
_MECHANICAL = (*THIRD_STOPS, Fraction(3), Fraction(1, 3))
_ALL = (*_MECHANICAL, *(Fraction(label) for label in _ELECTRONIC))

_THIRDS = (0, 3, 5)
"""Eighths of a stop by which Canon approximates thirds."""


def eighths(first: int, count: int) -> tuple[int, ...]:
    """Canon's codes of `count` settings a third of a stop apart, from the full stop `first` on."""
    return tuple(first + 8 * (step // 3) + _THIRDS[step % 3] for step in range(count))


CANON_TIMES: dict[int, Fraction] = {
    **dict(zip(eighths(0x10, len(THIRD_STOPS)), THIRD_STOPS, strict=True)),
    **{0x14 + 8 * step: Fraction(label) for step, label in enumerate(_HALVES)},
}
"""Property D102: seconds by code, 0x10 = 30 s to 0xA0 = 1/8000 s, an eighth of a stop a code."""


@dataclass(frozen=True)
class Coding:
    """Encoding of a property's values; `decode` gives None for bulb, automatic and unknown codes.

    candidates: all values of a number, more than one where the camera has rounded it away.
    standard: what to try where a camera lists no choices.
    """

    decode: Callable[[int], float | None]
    candidates: Callable[[int], tuple[float, ...]]
    standard: tuple[int, ...] = ()


def exact(decode: Callable[[int], float | None], standard: tuple[int, ...] = ()) -> Coding:
    """A coding in which every number has one meaning."""

    def candidates(code: int) -> tuple[float, ...]:
        value = decode(code)
        return () if value is None else (value,)

    return Coding(decode, candidates, standard)


def _as_ticks(labels: tuple[Fraction, ...], code: int) -> tuple[float, ...]:
    """The labels that come out as `code` ticks of 100 us, cut off or rounded: cameras do either."""
    return tuple(float(time) for time in labels if code in (math.floor(time * 10000), round(time * 10000)))


@lru_cache(maxsize=4096)
def _ticks(code: int) -> float | None:
    """The label nearest to a number of ticks of 100 us, or the ticks themselves without a label."""
    if not 0 < code < 0xFFFFFFF0:
        return None
    ticks = code * 1e-4
    return min(_as_ticks(_MECHANICAL, code) or (ticks,), key=lambda label: abs(math.log(label / ticks)))


@lru_cache(maxsize=4096)
def _tick_candidates(code: int) -> tuple[float, ...]:
    time = _ticks(code)
    return _as_ticks(_ALL, code) or (() if time is None else (time,))


TICKS = Coding(_ticks, _tick_candidates)
"""Property 500D, 100 us: 1 may be 1/6400, 1/8000 s or less, and 2 may be 1/4000 or 1/5000 s."""


MICROSECONDS = exact(lambda code: code * 1e-6 if 0 < code < 0xFFFFFFF0 else None)
"""Fuji's 500D: an X-T4 sent 19686, which is 2**(-17/3) s, where its dial stood at 1/50."""


def _quotient(code: int) -> float | None:
    """Numerator in the upper 16 bits, denominator in the lower; the last 16 codes are bulb and the like."""
    over, under = divmod(code, 1 << 16)
    return over / under if 0 < code < 0xFFFFFFF0 and over and under else None


def _as_quotient(label: str) -> int:
    """`1/8000` is 1 over 8000, `2.5` is 25 over 10, `0.3` is 1 over 3: as a Sony lists them."""
    over, _, under = ("1/3" if label == "0.3" else label).partition("/")
    tenths = "." in over
    return int(float(over) * 10 + 0.5 if tenths else int(over)) << 16 | (10 if tenths else int(under or 1))


QUOTIENT = exact(_quotient)
"""Nikon's D100: numerator << 16 | denominator, FFFFFFFF bulb, FFFFFFFE flash, FFFFFFFD time."""
SONY_QUOTIENT = exact(_quotient, tuple(_as_quotient(label) for label in SHUTTER_LABELS))
"""Sony's D20D: the same, 0 bulb; bodies send a range instead of a list, so a list is given here."""
CANON_SHUTTER = exact(lambda code: float(CANON_TIMES[code]) if code in CANON_TIMES else None)
"""Canon's D102."""

"""Dials: exposure settings of a camera as values, matched to its own list, written and read back."""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Protocol

from drivers.errors import CameraRefused
from drivers.ptp.protocol.codec import Value
from drivers.ptp.protocol.codes import (
    CanonProperty,
    NikonProperty,
    PropertyCode,
    SonyProperty,
)
from drivers.ptp.protocol.datasets import DevicePropDesc, EnumForm, RangeForm
from drivers.ptp.shutter import (
    CANON_SHUTTER,
    MICROSECONDS,
    QUOTIENT,
    SONY_QUOTIENT,
    TICKS,
    Coding,
    eighths,
    exact,
)
from imaging.optics.dial_settings import labels

_F_NUMBERS = labels(
    "1 1.1 1.2 1.4 1.6 1.8 2 2.2 2.5 2.8 3.2 3.5 4 4.5 5 5.6 6.3 7.1 8 9 10 11 13 14 16 18 20 22 25 29 32 "
    "36 40 45"
)
_HALF_F_NUMBERS = labels("1.2 1.8 2.5 3.5 4.5 6.7 9.5 13 19 27")
_ISOS = labels(
    "50 64 80 100 125 160 200 250 320 400 500 640 800 1000 1250 1600 2000 2500 3200 4000 5000 6400 8000 "
    "10000 12800 16000 20000 25600 32000 40000 51200 64000 80000 102400"
)

CANON_F_NUMBERS: dict[int, float] = {
    **dict(zip(eighths(0x08, len(_F_NUMBERS)), map(float, _F_NUMBERS), strict=True)),
    **{0x0C + 8 * step: float(label) for step, label in enumerate(_HALF_F_NUMBERS)},
}
"""Property D101: f-numbers by code, 0x08 = 1 and 0x20 = 2.8, an eighth of a stop a code."""
CANON_ISOS: dict[int, float] = dict(zip(eighths(0x40, len(_ISOS)), map(float, _ISOS), strict=True))
"""Property D103: ISO by code, 0x48 = 100 to 0x98 = 102400 and 0x40 = 50, an eighth of a stop a code."""

CANON_APERTURE = exact(CANON_F_NUMBERS.get)
CANON_ISO = exact(CANON_ISOS.get)
HUNDREDTHS = exact(lambda code: code / 100 if 0 < code < 0xFFFF else None)
"""Property 5007."""
PLAIN_ISO = exact(lambda code: float(code) if 0 < code < 0xFFFF else None)
"""Property 500F; 0xFFFF is automatic, some bodies send negative numbers for that."""
LONG_ISO = exact(lambda code: float(code) if 0 < code < 0xFFFFFF else None)
"""Nikon's D0B4 and Sony's D21E; Sony's 0xFFFFFF is automatic and its upper byte a mode."""

STANDARD_TIME = (PropertyCode.EXPOSURE_TIME, TICKS)
FUJI_TIME = (PropertyCode.EXPOSURE_TIME, MICROSECONDS)
STANDARD_F_NUMBER = (PropertyCode.F_NUMBER, HUNDREDTHS)
STANDARD_ISO = (PropertyCode.EXPOSURE_INDEX, PLAIN_ISO)
NIKON_TIME = (NikonProperty.SHUTTER_SPEED, QUOTIENT)
NIKON_ISO = (NikonProperty.ISO_EX, LONG_ISO)
CANON_DIALS = (
    (CanonProperty.SHUTTER_SPEED, CANON_SHUTTER),
    (CanonProperty.APERTURE, CANON_APERTURE),
    (CanonProperty.ISO_SPEED, CANON_ISO),
)
SONY_TIME, SONY_ISO = (SonyProperty.SHUTTER_SPEED, SONY_QUOTIENT), (SonyProperty.ISO, LONG_ISO)

SAME = 1 / 6
"""Stops within which two values are one: half of the third in which cameras are set."""
_READ_BACKS = 5
"""Read-backs of a setting before it counts as refused."""
_READ_BACK_PAUSE = 0.02


class Properties(Protocol):
    """Access to a make's properties."""

    def describe(self, code: int) -> DevicePropDesc:
        """A property as it is now."""
        ...

    def write(self, code: int, value: Value) -> None:
        """Set it."""
        ...


@dataclass(frozen=True)
class DialChoice:
    """A code of a dial and its value; `certain` unless the code may mean a value a stop's sixth away too."""

    code: int
    value: float
    certain: bool = True


class Dial:
    """One exposure setting of a camera."""

    def __init__(self, properties: Properties, code: int, coding: Coding) -> None:
        self._properties, self.code, self._coding = properties, code, coding
        self._confirmed: dict[int, float] = {}

    def choices(self) -> tuple[DialChoice, ...]:
        """Settable values, ascending; only the current one if the camera says that it cannot be set."""
        return self._choices(self._properties.describe(self.code))

    def learn(self, choice: DialChoice, value: float) -> None:
        """A file says what a code really was: remember it, if it is one of the things it can mean."""
        candidates = self._coding.candidates(choice.code)
        nearest = min(candidates, key=lambda candidate: apart(candidate, value), default=value)
        if candidates and apart(nearest, value) <= SAME:
            self._confirmed[choice.code] = nearest

    def set(self, value: float, sleep: Callable[[float], None]) -> DialChoice:
        """Set the nearest choice and return what the camera then says it is at.

        A setting that a busy body drops is written a second time. CameraRefused if there is no choice.
        """
        description = self._properties.describe(self.code)
        choices = self._choices(description)
        if not choices:
            raise CameraRefused(
                f"The camera offers no number for property 0x{self.code:04X}: switch it to manual exposure."
            )
        wanted = min(
            choices, key=lambda choice: min(apart(candidate, value) for candidate in self._values(choice))
        )
        for _ in range(2):
            if description.current == wanted.code or not description.writable:
                break
            self._properties.write(self.code, wanted.code)
            for look in range(_READ_BACKS):
                if look:
                    sleep(_READ_BACK_PAUSE)
                description = self._properties.describe(self.code)
                if description.current == wanted.code:
                    break
        current = self._choice(description.current)
        if current is None:
            raise CameraRefused(
                f"The camera went to code {description.current} of property 0x{self.code:04X}, "
                "which is no number: switch it to manual exposure."
            )
        if current.code == wanted.code and not current.certain:
            nearest = min(self._values(current), key=lambda candidate: apart(candidate, value))
            return DialChoice(current.code, nearest, certain=False)
        return current

    def _choices(self, description: DevicePropDesc) -> tuple[DialChoice, ...]:
        codes: Iterable[Value] = (description.current,)
        if description.writable:
            match description.form:
                case EnumForm(values) if values:
                    codes = values
                case RangeForm(int(low), int(high), int(step)) if not self._coding.standard:
                    # A range of codes with a meaning each; wide ones are no list of settings.
                    codes = range(low, high + 1, max(step, 1))[:4096]
                case _ if self._coding.standard:
                    codes = self._within(description.form)
        choices = {choice.code: choice for choice in map(self._choice, codes) if choice is not None}
        return tuple(sorted(choices.values(), key=lambda choice: choice.value))

    def _within(self, form: RangeForm | EnumForm | None) -> Iterable[int]:
        """The standard codes, between the ends of a range if the camera gave one."""
        if not isinstance(form, RangeForm):
            return self._coding.standard
        ends = [self._coding.decode(end) for end in (form.minimum, form.maximum) if isinstance(end, int)]
        limits = sorted(end for end in ends if end is not None)
        if len(limits) < 2:
            return self._coding.standard
        low, high = limits[0] * 0.999, limits[-1] * 1.001
        return [code for code in self._coding.standard if low <= (self._coding.decode(code) or 0.0) <= high]

    def _choice(self, code: Value) -> DialChoice | None:
        if not isinstance(code, int):
            return None
        if code in self._confirmed:
            return DialChoice(code, self._confirmed[code])
        value = self._coding.decode(code)
        if value is None:
            return None
        candidates = self._coding.candidates(code)
        return DialChoice(code, value, apart(min(candidates), max(candidates)) <= SAME)

    def _values(self, choice: DialChoice) -> tuple[float, ...]:
        return (choice.value,) if choice.certain else self._coding.candidates(choice.code)


def dial_values(dial: Dial | None) -> tuple[float, ...]:
    """Settable values of a dial, ascending; none without the dial."""
    return () if dial is None else tuple(choice.value for choice in dial.choices())


def apart(value: float, other: float) -> float:
    """Stops between two positive values."""
    return abs(math.log2(value / other))

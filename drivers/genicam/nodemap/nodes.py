"""Common parts of all nodes of a GenICam description: references, availability, access, limits."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

from drivers.errors import CameraProtocol, CameraRefused
from drivers.genicam.nodemap.description import Element
from drivers.genicam.nodemap.formula import Number, nearest_whole, wrapped

UNLIMITED = float("inf")
_WHOLE = ("Boolean", "Enumeration", "IntConverter", "IntReg", "IntSwissKnife", "Integer", "MaskedIntReg")
"""Kinds of nodes whose values are whole numbers."""
Value = Number | str | bool


class Memory(Protocol):
    """Address space of registers."""

    def read(self, address: int, size: int) -> bytes:
        """`size` bytes from `address`."""
        ...

    def write(self, address: int, data: bytes) -> None:
        """Write `data` to `address`."""
        ...


@dataclass(frozen=True)
class Limits:
    """The smallest and the largest value, and the step between values or their list, where there is one."""

    low: float
    high: float
    step: float | None = None
    values: tuple[float, ...] = ()

    def check(self, value: Number) -> None:
        """CameraRefused unless a value keeps to them."""
        off = 0.0 if not self.step or self.low == -UNLIMITED else (value - self.low) % self.step
        if not self.low <= value <= self.high or off or (self.values and value not in self.values):
            steps = f" in steps of {self.step:g}" if self.step else ""
            if self.values:
                steps = f", one of {', '.join(f'{one:g}' for one in self.values)}"
            raise CameraRefused(f"{value} is not in {self.low:g} to {self.high:g}{steps}: give another value")

    def nearest(self, value: float, *, whole: bool = False) -> Number:
        """The value that they allow and that is nearest; whole: a whole number."""
        allowed = [one for one in self.values if self.low <= one <= self.high]
        if allowed:
            value = min(allowed, key=lambda one: abs(one - value))
        value = min(max(value, self.low), self.high)
        step = self.step or (1 if whole else None)
        if step and not allowed:
            base = 0.0 if self.low == -UNLIMITED else self.low
            value = base + round((value - base) / step) * step
            if value > self.high:  # by rounding alone, or since the last step is not whole
                value = self.high if value - self.high < 1e-9 * step else value - step
        return round(value) if whole else float(value)


@dataclass
class Surroundings:
    """Environment of nodes: each other, the device's memory and, per frame, its chunks by ChunkID."""

    find: Callable[[str], "Node"]
    memory: Memory
    chunks: dict[int, bytes] = field(default_factory=dict)
    values: dict["Node | tuple[Node, str, bool]", Value] = field(default_factory=dict)
    """Cache of the node values, and of their limits in formulas, for the current feature, until something is
    written.

    Without it a formula that uses another twice, which uses another twice, takes exponential time.
    """


class Node:
    """A node; kinds of nodes override what they can do. Errors name no feature: the node map adds it."""

    def __init__(self, element: Element, around: Surroundings) -> None:
        self.element, self.around = element, around

    @property
    def whole(self) -> bool:
        """True if its values are integers."""
        return self.element.tag in _WHOLE

    def unit(self) -> str:
        """The unit that the description states; empty where it states none."""
        return self.element.first("Unit") or ""

    def get(self) -> Value:
        """The value: int, float or str."""
        raise CameraProtocol(f"a {self.element.tag} has no value")

    def value(self) -> Value:
        """The value, as other nodes refer to it: found out once for each question to the node map."""
        values = self.around.values
        if self not in values:
            values[self] = self.get()
        return values[self]

    def set(self, value: Value) -> None:
        """Set the value. CameraRefused if it cannot be."""
        raise CameraRefused(f"a {self.element.tag} cannot be set")

    def limits(self) -> Limits:
        """Return where the value may be."""
        return Limits(-UNLIMITED, UNLIMITED)

    def entry(self, name: str) -> int:
        """The number of the entry of that name, available or not. CameraProtocol without such an entry."""
        raise CameraProtocol(
            f"a formula needs the entry {name} of {self.element.name}, which has no such entry: update the "
            "firmware"
        )

    def target_access(self) -> str:
        """Return what the register or the node behind lets one do: RW, RO or WO."""
        return "RW"

    def available(self) -> bool:
        """Return whether it is implemented and there at the moment, and so is the node that keeps its value.

        One whose answer to that is not there, such as in a chunk that does not come, is not there either.
        """
        try:
            implemented = all(self._true(tag, True) for tag in ("pIsImplemented", "pIsAvailable"))
            behind = self.behind() if implemented else None
        except CameraRefused:
            return False
        return implemented and (behind is None or behind.available())

    def behind(self) -> "Node | None":
        """The node that keeps its value, if another does."""
        return None

    def access(self) -> str:
        """Return what may be done at the moment: letters of R and W."""
        if not self.available():
            return ""
        modes = {self.target_access(), self.element.first("ImposedAccessMode") or "RW"}
        may = "RW"
        if "RO" in modes or self._true("pIsLocked", False):
            may = may.replace("W", "")
        return may.replace("R", "") if "WO" in modes else may

    def refer(self, tag: str) -> "Node | None":
        """The node that <tag> names."""
        name = self.element.first(tag)
        return None if name is None else self.around.find(name)

    def number(self, tag: str) -> Number | None:
        """Return what <tag> says, or the value of the node that <pTag> names."""
        literal = self.element.first(tag)
        if literal is not None:
            return as_number(literal)
        node = self.refer("p" + tag)
        return None if node is None else numeric(node.value())

    def integer(self, tag: str) -> int | None:
        """Read `number` as an integer."""
        value = self.number(tag)
        return None if value is None else integral(value)

    def _true(self, tag: str, otherwise: bool) -> bool:
        node = self.refer(tag)
        return otherwise if node is None else bool(numeric(node.value()))


def numeric(value: Value) -> Number:
    """A value that must be a finite number. CameraProtocol."""
    if isinstance(value, str) or not math.isfinite(value):
        raise CameraProtocol(f"{value!r} is no number")
    return value


def integral(value: Value) -> int:
    """A value that must be a finite number, rounded to a whole one. CameraProtocol."""
    return nearest_whole(numeric(value))


def as_number(text: str) -> Number:
    """A literal: whole in tens or 0x, else a float, which may be infinite but not NaN. CameraProtocol."""
    try:
        if text.lower().startswith("0x"):
            return wrapped(int(text, 16))
        number = float(text) if set(text) & set(".eEnN") else wrapped(int(text))
    except ValueError:
        number = math.nan
    if math.isnan(number):
        raise CameraProtocol(f"{text!r} is no number")
    return number

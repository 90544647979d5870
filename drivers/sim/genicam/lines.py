"""Wires between simulated machine vision cameras, and their separate clocks."""

from dataclasses import dataclass
from functools import partial
from typing import Protocol, Self

from drivers.sim.seeds import generator
from drivers.sim.usb.timeline import Timeline


class LineDevice(Protocol):
    """A device whose lines can be wired."""

    serial: str
    wires: "dict[int, Wire]"
    """Wires on its lines, by number."""

    def line(self, number: int, rising: bool) -> None:
        """An edge arrives at one of its inputs."""
        ...


class Wire:
    """Joins lines of several devices: the edges of an output reach every other line on it a little later."""

    def __init__(self, timeline: Timeline, seed: int = 0) -> None:
        """seed: of how late each input sees an edge, 10 to 60 us, always the same for one input."""
        self._timeline, self._seed = timeline, seed
        self._ends: list[tuple[LineDevice, int, float]] = []

    def connect(self, device: LineDevice, line: int) -> None:
        """Solder a line of a device to it."""
        late = generator(self._seed, "wire", device.serial, line).uniform(10e-6, 60e-6)
        self._ends.append((device, line, float(late)))
        device.wires[line] = self

    def edge(self, rising: bool, source: LineDevice) -> None:
        """A device's output rises or falls."""
        for device, line, late in self._ends:
            if device is not source:
                self._timeline.call_later(late, partial(device.line, line, rising))


@dataclass(frozen=True)
class Oscillator:
    """The clock of a device: offset, s, to the clock of the host at its 0; drift, seconds a second."""

    offset: float
    drift: float

    @classmethod
    def of(cls, seed: int, serial: str) -> Self:
        """Draw an oscillator: on for up to ten hours already, and up to 100 ppm fast or slow."""
        chance = generator(seed, "oscillator", serial)
        return cls(float(chance.uniform(0.0, 36_000.0)), float(chance.uniform(-1e-4, 1e-4)))

    def nanoseconds(self, now: float) -> int:
        """Return what it shows at a time of the host."""
        return round(1e9 * (self.offset + now * (1.0 + self.drift)))

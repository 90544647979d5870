"""The time that simulated cameras on one network agree on by IEEE 1588, and how well each of them does."""

from dataclasses import dataclass

from drivers.sim.seeds import generator

WORST = 200e-9
"""Seconds that a camera is off at most: cameras state 1 us."""
SETTLING = 0.1
"""Seconds that it takes to agree."""


@dataclass(frozen=True)
class NetworkTime:
    """ns since 1970 at 0 of the simulation's timeline."""

    epoch: int = 1_790_000_000_000_000_000
    seed: int = 0

    def error_of(self, serial: str) -> float:
        """Lead of a camera's copy of the network time, seconds; constant."""
        return float(generator(self.seed, "ieee 1588", serial).uniform(-WORST, WORST))

    def nanoseconds(self, serial: str, now: float) -> int:
        """Return what a camera takes for the time."""
        return self.epoch + round(1e9 * (now + self.error_of(serial)))

    def when(self, serial: str, nanoseconds: int) -> float:
        """Return when a camera takes it to be that time."""
        return (nanoseconds - self.epoch) * 1e-9 - self.error_of(serial)

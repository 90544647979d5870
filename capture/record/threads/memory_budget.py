"""Bytes that all frames together may take, so that a slow disk or card cannot fill the memory."""

import math

from drivers.clock import Clock

BUDGET = 512 << 20
"""Bytes of frames between camera and disk."""


class MemoryBudget:
    """Room for frames; a thread that finds none waits on the clock."""

    def __init__(self, clock: Clock, limit: int = BUDGET) -> None:
        self._clock, self.limit = clock, limit
        self.held = 0

    def reserve(self, count: int) -> None:
        """Wait for room for `count` bytes; more than the limit is granted while nothing else is held."""
        while True:
            self._clock.wait(lambda: self._fits(count), math.inf)
            with self._clock.lock:
                if self._fits(count):
                    self.held += count
                    return

    def release(self, count: int) -> None:
        """Return `count` bytes."""
        self.replace(count, 0)

    def replace(self, reserved: int, held: int) -> None:
        """Replace the reservation by that many bytes, without waiting: they are in memory already."""
        with self._clock.lock:
            self.held += held - reserved
            self._clock.changed()

    def _fits(self, count: int) -> bool:
        return not self.held or self.held + count <= self.limit

"""Bytes that all frames together may take, so that a slow disk or card cannot fill the memory."""

import math

from drivers.clock import Clock

BUDGET = 512 << 20
"""Bytes of frames between camera and disk."""


class Budget:
    """Room for frames; who finds none waits on the clock."""

    def __init__(self, clock: Clock, limit: int = BUDGET) -> None:
        self._clock, self.limit = clock, limit
        self.held = 0

    def take(self, count: int) -> None:
        """Wait for room for `count` bytes; who wants more than there is at all gets it alone."""
        while True:
            self._clock.wait(lambda: self._fits(count), math.inf)
            with self._clock.lock:
                if self._fits(count):
                    self.held += count
                    return

    def give(self, count: int) -> None:
        """Return `count` bytes; a negative count is room that is taken without waiting."""
        with self._clock.lock:
            self.held -= count
            self._clock.changed()

    def _fits(self, count: int) -> bool:
        return not self.held or self.held + count <= self.limit

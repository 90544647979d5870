"""Time as drivers see it: given to them, so that simulated cameras can have a time of their own."""

import time
from typing import Protocol


class Clock(Protocol):
    """Seconds from an arbitrary moment, and waiting."""

    def now(self) -> float:
        """Seconds; never goes back."""
        ...

    def sleep(self, seconds: float) -> None:
        """Wait that long."""
        ...


class SystemClock:
    """The machine's monotonic clock."""

    def now(self) -> float:
        """`time.monotonic`."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """`time.sleep`."""
        time.sleep(seconds)

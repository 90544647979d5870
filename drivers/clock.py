"""Time as drivers and the threads that drive them see it: given to them, so that simulated cameras can
have a time of their own.
"""

import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import Protocol


class Clock(Protocol):
    """Seconds from an arbitrary moment, and all waiting: for a time, and of threads for one another."""

    @property
    def lock(self) -> AbstractContextManager[object]:
        """Held, again and again by one thread, while the state that conditions look at is touched."""
        ...

    def now(self) -> float:
        """Seconds; never goes back."""
        ...

    def sleep(self, seconds: float) -> None:
        """Wait that long."""
        ...

    def wait(self, ready: Callable[[], bool], seconds: float) -> bool:
        """Wait until `ready()`, evaluated with the lock held, or that long, `math.inf` for ever.

        Returns whether it was ready.
        """
        ...

    def changed(self) -> None:
        """Wake waiting threads, which evaluate their conditions again."""
        ...

    def worker(self, name: str) -> AbstractContextManager[object]:
        """A thread's place on the clock: taken before the thread starts, entered by the thread itself."""
        ...


class SystemClock:
    """The machine's monotonic clock; threads run when the system lets them."""

    def __init__(self) -> None:
        self._condition = threading.Condition(threading.RLock())

    @property
    def lock(self) -> AbstractContextManager[object]:
        """The lock of all state that threads on this clock wait for."""
        return self._condition

    def now(self) -> float:
        """`time.monotonic`."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """`time.sleep`."""
        time.sleep(seconds)

    def wait(self, ready: Callable[[], bool], seconds: float) -> bool:
        """Wait until `ready()` or that long."""
        with self._condition:
            return self._condition.wait_for(ready, min(seconds, threading.TIMEOUT_MAX))

    def changed(self) -> None:
        """Wake waiting threads, which evaluate their conditions again."""
        with self._condition:
            self._condition.notify_all()

    def worker(self, name: str) -> AbstractContextManager[object]:
        """Do nothing: the system knows its threads."""
        return nullcontext()


THIS_MACHINE = SystemClock()
"""The default clock."""

"""Time as simulated devices see it: a clock that also keeps appointments and waits for conditions."""

import heapq
import itertools
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Protocol

from drivers.clock import Clock

Action = Callable[[], None]


class Timeline(Clock, Protocol):
    """What the simulated bus and its devices run on; times in seconds."""

    @property
    def lock(self) -> AbstractContextManager[object]:
        """Held, again and again by one thread, while the state that conditions look at is touched."""
        ...

    def call_later(self, seconds: float, action: Action) -> None:
        """Have `action` done, with the lock held, after that time; it must not wait."""
        ...

    def wait(self, ready: Callable[[], bool], seconds: float) -> bool:
        """Wait until `ready()`, looked at with the lock held, or that long; whether it was ready."""
        ...

    def changed(self) -> None:
        """Have waiting threads look at their conditions again."""
        ...


class LiveTimeline:
    """The machine's own time, for front ends that other programs talk to. Close it when done."""

    def __init__(self) -> None:
        self._condition = threading.Condition(threading.RLock())
        self._numbers = itertools.count()
        self._appointments: list[tuple[float, int, Action]] = []
        self._open = True
        self._thread = threading.Thread(target=self._keep, name="timeline", daemon=True)
        self._thread.start()

    @property
    def lock(self) -> AbstractContextManager[object]:
        """The lock of all state on this timeline."""
        return self._condition

    def now(self) -> float:
        """`time.monotonic`."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """`time.sleep`."""
        time.sleep(seconds)

    def call_later(self, seconds: float, action: Action) -> None:
        """Have `action` done after that time, on the timeline's own thread."""
        with self._condition:
            heapq.heappush(self._appointments, (self.now() + seconds, next(self._numbers), action))
            self._condition.notify_all()

    def wait(self, ready: Callable[[], bool], seconds: float) -> bool:
        """Wait until `ready()` or that long."""
        with self._condition:
            return self._condition.wait_for(ready, seconds)

    def changed(self) -> None:
        """Have waiting threads look again."""
        with self._condition:
            self._condition.notify_all()

    def close(self) -> None:
        """Drop what has not happened yet."""
        with self._condition:
            self._open = False
            self._condition.notify_all()
        self._thread.join()

    def _keep(self) -> None:
        with self._condition:
            while self._open:
                if not self._appointments:
                    self._condition.wait()
                elif (left := self._appointments[0][0] - self.now()) > 0:
                    self._condition.wait(left)
                else:
                    heapq.heappop(self._appointments)[2]()
                    self._condition.notify_all()

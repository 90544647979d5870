"""Time as simulated devices see it: a clock that also keeps appointments."""

import heapq
import itertools
import threading
from collections.abc import Callable
from typing import Protocol

from drivers.clock import Clock, SystemClock

Action = Callable[[], None]


class Timeline(Clock, Protocol):
    """Timeline of the simulated bus and its devices; times in seconds."""

    def call_later(self, seconds: float, action: Action) -> None:
        """Run `action` after that time, with the lock held; it must not wait."""
        ...


class LiveTimeline(SystemClock):
    """The machine's own time, for front ends that other programs talk to. Close it when done."""

    def __init__(self) -> None:
        super().__init__()
        self._numbers = itertools.count()
        self._appointments: list[tuple[float, int, Action]] = []
        self._open = True
        self._thread = threading.Thread(target=self._keep, name="timeline", daemon=True)
        self._thread.start()

    def call_later(self, seconds: float, action: Action) -> None:
        """Run `action` after that time, on the timeline's own thread."""
        with self._condition:
            heapq.heappush(self._appointments, (self.now() + seconds, next(self._numbers), action))
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
                elif (seconds := self._appointments[0][0] - self.now()) > 0:
                    self._condition.wait(seconds)
                else:
                    heapq.heappop(self._appointments)[2]()
                    self._condition.notify_all()

"""Threads that begin and end together, and what they hand to one another; all waiting is on a clock."""

import math
import threading
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from types import TracebackType
from typing import Generic, Self, TypeVar

from drivers.clock import Clock

LEAVE = 5.0
"""Seconds that threads are given to come to an end when a run breaks off."""

T = TypeVar("T")


class Inbox(Generic[T]):
    """Queue for one or several threads."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._items: deque[T] = deque()
        self._closed = False

    def put(self, item: T) -> None:
        """Leave something; what comes after the end is dropped."""
        with self._clock.lock:
            if not self._closed:
                self._items.append(item)
            self._clock.changed()

    def get(self) -> T | None:
        """The oldest item, waited for; None at the end."""
        while True:
            self._clock.wait(lambda: bool(self._items) or self._closed, math.inf)
            with self._clock.lock:
                if self._items:
                    return self._items.popleft()
                if self._closed:
                    return None

    def poll(self) -> T | None:
        """Return the oldest item, or None."""
        with self._clock.lock:
            return self._items.popleft() if self._items else None

    @property
    def has_items(self) -> bool:
        """True if an item waits."""
        with self._clock.lock:
            return bool(self._items)

    def take_all(self) -> list[T]:
        """Return the items not yet taken, oldest first."""
        with self._clock.lock:
            items = list(self._items)
            self._items.clear()
            return items

    def close(self) -> None:
        """Drop the items not yet taken; nothing more will come."""
        with self._clock.lock:
            self._items.clear()
            self._closed = True
            self._clock.changed()


class ThreadGroup:
    """A thread for each job, begun and ended by `with`; `end` has the jobs return.

    defect: the exception that ended one of them, None if there was none.
    """

    def __init__(self, clock: Clock, jobs: Mapping[str, Callable[[], None]], end: Callable[[], None]) -> None:
        self._clock, self._jobs, self._end = clock, jobs, end
        self._threads: list[threading.Thread] = []
        self._ended = 0
        self.defect: BaseException | None = None

    def __enter__(self) -> Self:
        places = {name: self._clock.worker(name) for name in self._jobs}
        self._threads = [
            threading.Thread(target=self._run, args=(job, places[name]), name=name, daemon=True)
            for name, job in self._jobs.items()
        ]
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        self._end()
        # When a run breaks off, a camera in the middle of a long exposure is not waited for.
        seconds = math.inf if kind is None else LEAVE
        if self._clock.wait(lambda: self._ended == len(self._threads), seconds):
            for thread in self._threads:
                thread.join()

    def _run(self, job: Callable[[], None], place: AbstractContextManager[object]) -> None:
        with place:
            try:
                job()
            except BaseException as error:
                self.defect = error
            with self._clock.lock:
                self._ended += 1
                self._clock.changed()

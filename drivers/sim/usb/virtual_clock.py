"""A time that passes only when everybody waits for it, so that a 30 s exposure takes no 30 s.

A discrete-event scheduler: one worker runs at a time, until it waits; then comes what is next in the
order of (time, sequence number). What happens, and in which order, so depends on no thread scheduling.
Workers must wait for one another through the clock (`wait`), never through a lock or a queue alone.
"""

import heapq
import itertools
import math
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager
from enum import Enum
from types import TracebackType
from typing import Self

from drivers.sim.usb.timeline import Action

_PATIENCE = 60.0
"""Seconds of real time after which a stalled clock raises."""


class _Stage(Enum):
    ABSENT = "has not begun"
    WAITING = "waits"
    RUNNING = "runs"
    GONE = "has left"


class ClockStopped(RuntimeError):
    """Every worker waits for something that no time brings, or for a worker that never begins."""


class Worker:
    """A thread's place on the clock: taken before the thread starts, entered by the thread itself."""

    def __init__(self, clock: "VirtualClock", name: str, deadline: float, number: int) -> None:
        self.name = name
        self._clock = clock
        self.stage = _Stage.ABSENT
        self.deadline, self.number = deadline, number
        self.ready: Callable[[], bool] | None = None
        self.outcome = False
        self.turn = threading.Condition(clock.lock_of_workers)

    def __enter__(self) -> Self:
        self._clock.begin(self)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        self._clock.leave(self)


class VirtualClock:
    """A `Timeline` of virtual seconds from 0.

    A thread that is no worker may wait too: it counts while it waits. With no workers, one thread has the
    clock to itself, and its runs repeat exactly as those of workers do.
    """

    def __init__(self) -> None:
        self.lock_of_workers = threading.RLock()
        self._now = 0.0
        self._numbers = itertools.count()
        self._events: list[tuple[float, int, Action]] = []
        self._workers: list[Worker] = []
        self._by_thread: dict[int, Worker] = {}
        self._acting = False

    @property
    def lock(self) -> AbstractContextManager[object]:
        """The lock of all state on this clock."""
        return self.lock_of_workers

    def now(self) -> float:
        """Virtual seconds."""
        with self.lock:
            return self._now

    def sleep(self, seconds: float) -> None:
        """Wait that long, in virtual time."""
        self.wait(lambda: False, max(0.0, seconds))

    def call_later(self, seconds: float, action: Action) -> None:
        """Run `action` at now + `seconds`, on whichever thread moves the clock on."""
        with self.lock:
            heapq.heappush(self._events, (self._now + seconds, next(self._numbers), action))
            self._move_on()

    def changed(self) -> None:
        """Wake waiting threads, which evaluate their conditions again."""
        with self.lock:
            self._move_on()

    def worker(self, name: str) -> Worker:
        """A place on the clock, for a `with` in a thread; no time passes until that thread is there.

        Take the places of all threads before the first one starts: their order is the order of running.
        """
        with self.lock:
            worker = Worker(self, name, self._now, next(self._numbers))
            self._workers.append(worker)
            return worker

    def wait(self, ready: Callable[[], bool], seconds: float) -> bool:
        """Wait until `ready()` or that long, `math.inf` for ever; whether it was ready. ClockStopped."""
        with self.lock:
            if ready():
                return True
            worker = self._by_thread.get(threading.get_ident())
            guest = worker is None
            if worker is None:
                worker = Worker(self, threading.current_thread().name, 0.0, 0)
                self._workers.append(worker)
            worker.deadline, worker.number = self._now + seconds, next(self._numbers)
            worker.ready = ready
            try:
                self._yield(worker)
            finally:
                worker.stage = _Stage.RUNNING
                if guest:
                    self._workers.remove(worker)
                    self._move_on()
            return worker.outcome

    def begin(self, worker: Worker) -> None:
        """The worker's thread is there and waits for its turn."""
        with self.lock:
            self._by_thread[threading.get_ident()] = worker
            self._yield(worker)

    def leave(self, worker: Worker) -> None:
        """The worker's thread is done."""
        with self.lock:
            worker.stage = _Stage.GONE
            del self._by_thread[threading.get_ident()]
            self._workers.remove(worker)
            self._move_on()

    def _yield(self, worker: Worker) -> None:
        """Wait for the worker's turn."""
        worker.stage = _Stage.WAITING
        self._move_on()
        while worker.stage is _Stage.WAITING:
            if not worker.turn.wait(_PATIENCE) and not self._somebody(_Stage.RUNNING):
                states = ", ".join(f"{worker.name} {worker.stage.value}" for worker in self._workers)
                raise ClockStopped(f"the virtual clock stands still at {self._now:g} s: {states}")

    def _somebody(self, stage: _Stage) -> bool:
        return any(worker.stage is stage for worker in self._workers)

    def _move_on(self) -> None:
        """Run the next action if all threads wait, until one of them is ready."""
        if self._acting:
            return  # An action makes an appointment: no time passes before it is done.
        while self._workers and all(worker.stage is _Stage.WAITING for worker in self._workers):
            roused = [worker for worker in self._workers if worker.ready is not None and worker.ready()]
            if roused:
                self._give_turn(min(roused, key=lambda worker: worker.number), outcome=True)
                return
            first = min(self._workers, key=lambda worker: (worker.deadline, worker.number))
            if self._events and self._events[0][:2] < (first.deadline, first.number):
                moment, _, action = heapq.heappop(self._events)
                self._now = max(self._now, moment)
                self._acting = True
                try:
                    action()
                finally:
                    self._acting = False
            elif first.deadline < math.inf:
                self._now = max(self._now, first.deadline)
                self._give_turn(first, outcome=False)
            else:
                return

    def _give_turn(self, worker: Worker, *, outcome: bool) -> None:
        worker.outcome, worker.stage, worker.ready = outcome, _Stage.RUNNING, None
        worker.turn.notify()

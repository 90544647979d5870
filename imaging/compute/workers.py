"""Several tasks at once: each begins when what it is forecast to take is free beside those that run."""

import multiprocessing
import os
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Concatenate, ParamSpec, Protocol, TypeVar

from imaging.compute import cores as core_count
from imaging.compute import memory
from imaging.compute.cores import available_cores
from imaging.errors import InputError, RigError

ATTEMPTS = 2
"""Attempts at a task whose process was killed, as by a machine that went down or ran out of memory."""
SHARE = 0.9
"""Share of the free memory that tasks may take together."""

P = ParamSpec("P")
T = TypeVar("T")


class WorkerLost(RigError):
    """The process or the machine of a task was lost, and again when it was tried again."""


@dataclass(frozen=True)
class Task:
    """Forecast demand of a task. memory: bytes at its peak; gpu: whether it uses a GPU, if there is one."""

    memory: int
    gpu: bool = False


@dataclass(frozen=True)
class Share:
    """Resources that a task may use on its machine.

    cores: how many; pinned: which ones, if not any; room: bytes, that its own decisions keep to as the
    forecast did; gpu: as CUDA_VISIBLE_DEVICES has it, if not any. None: no limit. serves: the process
    that the task is called in is there for tasks alone.
    """

    cores: int | None = None
    pinned: frozenset[int] | None = None
    room: int | None = None
    gpu: str | None = None
    serves: bool = False

    def environment(self) -> dict[str, str]:
        """Environment variables of a process that keeps to the share."""
        given = {core_count.GIVEN: self.cores, memory.GIVEN: self.room, "CUDA_VISIBLE_DEVICES": self.gpu}
        return {name: str(value) for name, value in given.items() if value is not None}

    def pin(self, process: int) -> None:
        """Keep a process on its cores, where the system can."""
        if self.pinned and hasattr(os, "sched_setaffinity"):
            os.sched_setaffinity(process, self.pinned)

    def take(self) -> None:
        """Restrict this process to the share."""
        os.environ.update(self.environment())
        self.pin(0)


class Workers(Protocol):
    """Executor of tasks.

    room: bytes that a single one may take; cores: that it has. at_once: how many are worth having under way;
    beside: how many may share a machine.
    """

    room: int
    cores: int
    at_once: int
    beside: int

    def submit(
        self, task: Task, function: Callable[Concatenate[Share, P], T], *arguments: P.args, **named: P.kwargs
    ) -> "Future[T]":
        """Call a function of a module with its share, when there is room for the task."""
        ...

    def close(self) -> None:
        """Begin nothing more, and wait for what is running."""
        ...


def apart(share: Share, function: Callable[..., T], *arguments: Any) -> T:
    """Return what a function of a module returns in a separate process; retry where that was killed.

    WorkerLost if each attempt was killed. In a process that serves tasks alone, its parent retries instead.
    """
    if share.serves:
        share.take()
        return function(*arguments)
    context = multiprocessing.get_context("spawn")  # a fork would inherit threads that are not there
    for _ in range(ATTEMPTS):
        with ProcessPoolExecutor(1, mp_context=context, initializer=_begun, initargs=(share,)) as pool:
            try:
                return pool.submit(function, *arguments).result()
            except BrokenProcessPool:
                continue
    raise WorkerLost(f"its process was killed {ATTEMPTS} times, as where memory runs out.")


def _begun(share: Share) -> None:
    """Keep to the share in the new process, and end with the parent, however that ends."""
    share.take()
    parent = multiprocessing.parent_process()
    assert parent is not None

    def end() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=end, daemon=True).start()


@dataclass
class LocalWorkers:
    """Threads of this process, which start others: tasks begin in their order, as soon as they fit.

    Each has its share of the cores. One that leaves less than a share of the memory to others runs alone, on
    all cores. gpus: as CUDA_VISIBLE_DEVICES has them; a task that takes one has it to itself.
    """

    count: int
    gpus: Sequence[str] = ()
    room: int = field(init=False)
    cores: int = field(init=False)
    at_once: int = field(init=False)
    beside: int = field(init=False)
    _pool: ThreadPoolExecutor = field(init=False)
    _pins: "list[frozenset[int]]" = field(init=False)
    _gpus: list[str] = field(init=False)
    _change: threading.Condition = field(default_factory=threading.Condition)
    _line: "deque[object]" = field(default_factory=deque)
    _running: list[Task] = field(default_factory=list)
    _closed: bool = False

    def __post_init__(self) -> None:
        if self.count > available_cores():
            raise InputError(f"--workers {self.count} is more than the {available_cores()} cores there are.")
        self.room = int((SHARE if self.count > 1 else 1.0) * memory.available())
        self.cores = available_cores() // self.count
        self.at_once = self.beside = self.count
        self._gpus = list(self.gpus)
        self._pool = ThreadPoolExecutor(self.count)
        every = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []
        self._pins = [frozenset(every[number :: self.count]) for number in range(self.count)]

    def submit(
        self, task: Task, function: Callable[Concatenate[Share, P], T], *arguments: P.args, **named: P.kwargs
    ) -> "Future[T]":
        """Submit as `Workers.submit`. What fits nowhere runs alone, and reports a lack of memory itself."""

        def run() -> T:
            with self._admitted(task) as share:
                return function(share, *arguments, **named)

        return self._pool.submit(run)

    def close(self) -> None:
        """Close as `Workers.close`."""
        with self._change:
            self._closed = True
            self._change.notify_all()
        self._pool.shutdown(wait=True, cancel_futures=True)

    def alone(self, task: Task) -> bool:
        """Return whether nothing runs beside it."""
        return self.count == 1 or task.memory > self.room * (1 - 1 / self.count)

    @contextmanager
    def _admitted(self, task: Task) -> Iterator[Share]:
        """Wait until all before it have begun and it fits; its share, until the block ends."""
        turn = object()
        with self._change:
            self._line.append(turn)
            self._change.wait_for(lambda: self._closed or (self._line[0] is turn and self._fits(task)))
            if self._closed:
                raise CancelledError
            self._line.popleft()
            self._running.append(task)
            pins = None if self.alone(task) else self._pins.pop()
            gpu = self._gpus.pop(0) if task.gpu and self._gpus else None
            self._change.notify_all()
        try:
            yield Share(None if pins is None else self.cores, pins, self.room, gpu)
        finally:
            with self._change:
                self._running.remove(task)
                if pins is not None:
                    self._pins.append(pins)
                if gpu is not None:
                    self._gpus.append(gpu)
                self._change.notify_all()

    def _fits(self, task: Task) -> bool:
        if not self._running:
            return True
        if self.alone(task) or any(map(self.alone, self._running)):
            return False
        if task.gpu and self.gpus and not self._gpus:
            return False
        return sum(one.memory for one in self._running) + task.memory <= self.room

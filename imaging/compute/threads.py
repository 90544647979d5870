"""Running one kernel on all cores, robust on a busy machine.

A job is cut into numbered tasks; every thread takes the next number from a shared counter until none is
left, so an uneven or slow core costs little. The calling thread works too, and a helper that the system
has not woken by the time the tasks are gone is not waited for: OpenMP, which Numba's own `prange` uses,
waits for every thread at the end of each loop, and may not be followed by a fork.
"""

import os
import threading
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import copy_context
from queue import SimpleQueue
from typing import Any, TypeVar

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.extending import intrinsic
from threadpoolctl import threadpool_limits

from imaging.compute.cores import available_cores
from imaging.compute.jit import Kernel

T = TypeVar("T")


@intrinsic  # type: ignore[untyped-decorator]
def take_number(typing_context: Any, counter: Any) -> Any:
    """Add 1 to counter[0] (int64) atomically inside a kernel, and return its old value."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pointer = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        return builder.atomic_rmw("add", pointer, ir.Constant(ir.IntType(64), 1), "monotonic")

    return types.int64(counter), generate


class _Job:
    """A kernel with its arguments, open to helpers until the caller closes it."""

    def __init__(self, kernel: Kernel, arguments: tuple[Any, ...]) -> None:
        self._kernel, self._arguments = kernel, arguments
        self._change = threading.Condition()
        self._active, self._open = 0, True
        self._error: BaseException | None = None

    def help(self) -> None:
        with self._change:
            if not self._open:
                return
            self._active += 1
        try:
            self._kernel(*self._arguments)
        except BaseException as error:
            self._error = error
        with self._change:
            self._active -= 1
            self._change.notify()

    def close(self) -> None:
        """Wait for the helpers that have begun; an error of theirs is raised here."""
        with self._change:
            self._open = False
            while self._active:
                self._change.wait()
        if self._error is not None:
            raise self._error


_jobs: "SimpleQueue[_Job]" = SimpleQueue()
_helpers = 0


_threads = available_cores()


def _help_forever(jobs: "SimpleQueue[_Job]") -> None:
    while True:
        jobs.get().help()


def _forget_helpers() -> None:
    """Forget the helper threads in a forked child, which has none."""
    global _jobs, _helpers
    _jobs, _helpers = SimpleQueue(), 0


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_helpers)


def thread_count() -> int:
    """Threads that `share` uses; at first the cores this process may run on."""
    return _threads


def set_threads(count: int) -> None:
    """Use `count` threads (at least 1). No result depends on it."""
    global _threads
    _threads = max(1, count)


def share(kernel: Kernel, work: float, *arguments: Any) -> None:
    """Call `kernel(counter, *arguments)` on all threads, counter being an int64 array [1] that holds 0.

    The kernel takes task numbers with `take_number(counter)` and returns when they are beyond its last
    task. work: a rough estimate of the cost in microseconds; a small job is not worth waking a thread.
    """
    global _helpers
    counter = np.zeros(1, np.int64)
    if work < 100.0 or _threads == 1:
        kernel(counter, *arguments)
        return
    while _helpers < _threads - 1:
        threading.Thread(target=_help_forever, args=(_jobs,), daemon=True, name="rig-kernel").start()
        _helpers += 1
    job = _Job(kernel, (counter, *arguments))
    for _ in range(_threads - 1):
        _jobs.put(job)
    try:
        kernel(counter, *arguments)
    finally:
        job.close()


@contextmanager
def one_thread_a_product() -> Iterator[None]:
    """Run numpy's matrix products on the calling thread until the block or the function ends.

    BLAS would share each small one among all cores, whose threads then spin until the next: on two busy
    cores a calibration took twice the processor time, and no less of the clock's.
    """
    with threadpool_limits(limits=1, user_api="blas"):
        yield


def in_turn(count: int, work: Callable[[int], T], most: int | None = None) -> Iterator[T]:
    """`work(number)` of 0..count-1 in their order, each found on one of all threads, some of them ahead.

    For work that leaves Python's lock most of the time; each has one thread for products of numpy. Who ends
    before the last number waits for what has begun. Context variables are the caller's. most: of threads,
    where each takes memory.
    """
    threads = _threads if most is None else min(most, _threads)
    contexts = [copy_context() for _ in range(count)]

    def within(number: int) -> T:
        return contexts[number].run(work, number)

    with one_thread_a_product(), ThreadPoolExecutor(threads) as pool:
        try:
            yield from in_order(pool, count, within, 2 * threads)
        finally:
            pool.shutdown(cancel_futures=True)


def in_order(pool: ThreadPoolExecutor, count: int, work: Callable[[int], T], ahead: int) -> Iterator[T]:
    """Yield `work(number)` for 0..count-1 in order, computed by the pool with a bounded number in flight.

    Args:
        pool: Threads.
        count: Number of calls.
        work: Function of a number, called on the threads of the pool.
        ahead: Largest number of calls that are begun beyond the result in use.

    Returns:
        The results, in the order of the numbers; an exception of `work` is raised in the place of its result.
    """
    begun: deque[Future[T]] = deque()
    for number in range(count):
        begun.append(pool.submit(work, number))
        if len(begun) > ahead:
            yield begun.popleft().result()
    while begun:
        yield begun.popleft().result()


def share_pieces(count: int, stride: int, work: Callable[[int, int], None]) -> None:
    """Call `work(first, last)` on pieces of `stride` that cover 0..count, on all threads.

    For work that leaves Python's lock for milliseconds at a time; it needs no counter in the kernel.
    """
    pieces = [(first, min(first + stride, count)) for first in range(0, count, stride)]
    with ThreadPoolExecutor(max_workers=min(_threads, max(len(pieces), 1))) as pool:
        for _ in pool.map(lambda piece: work(*piece), pieces):
            pass

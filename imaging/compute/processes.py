"""Work that keeps Python's lock, on several cores: processes that a caller's own program never sees.

`multiprocessing` would import the program that calls in each of its processes, where a script of some lines
without an `if __name__ == "__main__"` begins anew.
"""

import os
import pickle
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from queue import SimpleQueue
from typing import Any, TypeVar

from imaging.compute import memory
from imaging.compute.threads import in_order
from imaging.compute.workers import Share

T = TypeVar("T")

_PROGRAM = "from imaging.compute.process_server import serve; serve()"
_LIBRARIES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OPENCV_FOR_THREADS_NUM")
"""Threads of libraries, which would share each core among all processes."""


class _Process:
    """One that answers calls, begun with the first; a call is made here where it is lost."""

    def __init__(self, share: Share) -> None:
        self._environment = os.environ | dict.fromkeys(_LIBRARIES, "1") | share.environment()
        self._environment["PYTHONPATH"] = os.pathsep.join(filter(None, sys.path))
        self._child: subprocess.Popen[bytes] | None = None
        self._lost = self._unwanted = False

    def call(self, function: Callable[..., T], arguments: tuple[Any, ...]) -> T:
        """Return what the function returns or raises there."""
        if not self._lost:
            try:
                done, answer = self._ask(function, arguments)
            except Exception:  # of any type, as the classes of answers have them when they are read
                if self._unwanted:
                    raise
                self._lost = True  # it was killed, as where memory runs out, or its answer cannot be sent
            else:
                if done:
                    return answer  # type: ignore[no-any-return]
                raise answer
        return function(*arguments)

    def kill(self) -> None:
        """Kill the process, and drop what it computes."""
        self._unwanted = True
        if self._child is not None:
            self._child.kill()

    def close(self) -> None:
        """Close the pipe to a process whose results are no longer awaited."""
        if self._child is not None:
            self._child.wait()
            for pipe in (self._child.stdin, self._child.stdout):
                assert pipe is not None
                with suppress(OSError):  # a call that was not written whole
                    pipe.close()

    def _ask(self, function: Callable[..., Any], arguments: tuple[Any, ...]) -> tuple[bool, Any]:
        if self._child is None:
            self._child = subprocess.Popen(
                [sys.executable, "-P", "-c", _PROGRAM],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                env=self._environment,
            )
        if self._unwanted:
            self._child.kill()
        assert self._child.stdin is not None
        assert self._child.stdout is not None
        pickle.dump((function, arguments), self._child.stdin)
        self._child.stdin.flush()
        done, answer = pickle.load(self._child.stdout)
        return done, answer


def in_processes(count: int, function: Callable[..., T], arguments: Sequence[tuple[Any, ...]]) -> Iterator[T]:
    """`function(*one)` of each of `arguments`, in their order, found in `count` processes of one core each.

    function: of a module. What it raises is raised here, in its turn; who ends before the last one does not
    wait for what has begun. With a count of 1 all of it is done here.
    """
    if count <= 1:
        yield from (function(*one) for one in arguments)
        return
    share = Share(cores=1, room=memory.available() // count)
    every = [_Process(share) for _ in range(count)]
    idle: SimpleQueue[_Process] = SimpleQueue()
    for process in every:
        idle.put(process)

    def call(number: int) -> T:
        process = idle.get()
        try:
            return process.call(function, arguments[number])
        finally:
            idle.put(process)

    try:
        with ThreadPoolExecutor(count) as pool:
            try:
                yield from in_order(pool, len(arguments), call, 2 * count)
            finally:
                pool.shutdown(wait=False, cancel_futures=True)
                for process in every:
                    process.kill()
    finally:
        for process in every:
            process.close()

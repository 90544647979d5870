"""Cost of work with child processes: processor seconds, and memory."""

import os
import resource
import threading
from pathlib import Path
from types import TracebackType
from typing import Self

EVERY = 0.05
"""Seconds between looks at the memory."""


def processor_seconds() -> float:
    """Processor seconds of this process and of its ended children."""
    return sum(
        usage.ru_utime + usage.ru_stime
        for usage in map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    )


class Memory:
    """Peak memory of this process and its children until the block ends: `peak`, bytes."""

    def __init__(self) -> None:
        self.peak = _resident()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._look, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._over.set()
        self._thread.join()

    def _look(self) -> None:
        while not self._over.wait(EVERY):
            self.peak = max(self.peak, _resident())


def _resident() -> int:
    """Bytes; what processes share counts for each of them."""
    pages = 0
    processes = [os.getpid()]
    for process in processes:
        folder = Path("/proc") / str(process)
        try:
            pages += int((folder / "statm").read_text("ascii").split()[1])
            for task in (folder / "task").iterdir():
                processes += map(int, (task / "children").read_text("ascii").split())
        except (OSError, ValueError):  # it has ended
            continue
    return pages * os.sysconf("SC_PAGE_SIZE")

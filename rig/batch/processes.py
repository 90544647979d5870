"""A command of rig in a process of its own: on a share of this machine, or where a cluster has room."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, field
from queue import SimpleQueue
from typing import Any

from capture.nodes.cluster import joined
from imaging.compute import memory
from imaging.compute.cores import available_cores
from imaging.errors import InputError

ATTEMPTS = 2
"""Of a command whose process was killed, as by a machine that went down or ran out of memory."""
KEPT = 0.9
"""Of the free memory, what several processes share."""


@dataclass(frozen=True)
class Ended:
    """How a command ended: what it printed as JSON, and its last sentence."""

    code: int
    data: dict[str, Any]
    says: str
    seconds: float
    attempts: int = 1


Submit = Callable[[Sequence[str]], "Future[Ended]"]
"""Runs `python -m rig` with these words and `--json`."""


def run(words: Sequence[str], cores: frozenset[int] | None = None, room: int | None = None) -> Ended:
    """Run a command to its end; again where its process was killed.

    cores: on which it may run; None: on all. room: bytes of address space that it may take; None: all.
    """
    began = time.monotonic()
    attempt = 1
    code, out, err = _once(words, cores, room)
    while code < 0 and attempt < ATTEMPTS:
        attempt += 1
        code, out, err = _once(words, cores, room)
    try:
        data = json.loads(out)
    except ValueError:
        data = {}
    says = next((line for line in reversed(err.splitlines()) if line.strip()), "")
    if code < 0:
        says = f"its process was killed {attempt} times ({signal.Signals(-code).name})."
    return Ended(code, data, says, time.monotonic() - began, attempt)


def _once(words: Sequence[str], cores: frozenset[int] | None, room: int | None) -> tuple[int, str, str]:
    command = [sys.executable, "-m", "rig", *words, "--json"]
    with subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        if hasattr(os, "sched_setaffinity") and cores is not None:
            os.sched_setaffinity(process.pid, cores)
        if sys.platform == "linux" and room is not None:
            import resource

            resource.prlimit(process.pid, resource.RLIMIT_AS, (room, room))
        out, err = process.communicate()
    return process.returncode, out, err


@dataclass
class LocalWorkers:
    """Processes on this machine, each with its share of the cores and of the memory."""

    count: int
    _pool: ThreadPoolExecutor = field(init=False)
    _shares: "SimpleQueue[frozenset[int]]" = field(init=False)

    def __post_init__(self) -> None:
        if self.count > available_cores():
            raise InputError(f"--workers {self.count} is more than the {available_cores()} cores there are.")
        self._pool = ThreadPoolExecutor(self.count)
        self._shares = SimpleQueue()
        every = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []
        for number in range(self.count):
            self._shares.put(frozenset(every[number :: self.count]))

    def submit(self, words: Sequence[str]) -> "Future[Ended]":
        """Run a command when a share is free."""
        return self._pool.submit(self._run, words)

    def _run(self, words: Sequence[str]) -> Ended:
        if self.count == 1:
            return run(words)
        cores = self._shares.get()
        try:
            return run(words, cores or None, int(KEPT * memory.available() / self.count))
        finally:
            self._shares.put(cores)

    def close(self) -> None:
        """Begin nothing more, and wait for what is running."""
        self._pool.shutdown(wait=True, cancel_futures=True)


@dataclass
class RayWorkers:
    """Processes on the nodes of a Ray cluster, which see the sessions at the same paths.

    cores: of a node, that a command takes; memory: bytes that it takes.
    """

    address: str
    cores: int
    memory: int
    _stack: ExitStack = field(default_factory=ExitStack)

    def __post_init__(self) -> None:
        ray = self._stack.enter_context(joined(self.address))
        self._run = ray.remote(run).options(
            num_cpus=self.cores, memory=self.memory, max_retries=ATTEMPTS, retry_exceptions=False
        )

    def submit(self, words: Sequence[str]) -> "Future[Ended]":
        """Run a command on whichever node has room; again on another where its node is lost."""
        future: Future[Ended] = self._run.remote(list(words)).future()
        return future

    def close(self) -> None:
        """Leave the cluster; what is running there is stopped."""
        self._stack.close()

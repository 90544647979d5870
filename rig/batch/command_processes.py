"""A command of rig in a process of its own: on a share of this machine, or where a cluster has room."""

import json
import math
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from typing import IO, Any, Concatenate, ParamSpec, TypeVar

from capture.nodes.cluster import joined
from imaging.compute import memory
from imaging.compute.workers import ATTEMPTS, LocalWorkers, Share, Task, WorkerLost, Workers
from imaging.errors import InputError
from rig.batch import forks

P = ParamSpec("P")
T = TypeVar("T")


@dataclass(frozen=True)
class Cost:
    """Processor seconds and peak memory (bytes) of a process; None where the system does not count them."""

    processor_seconds: float | None = None
    peak: int | None = None

    def __add__(self, other: "Cost") -> "Cost":
        """Return the cost of this process and then another."""
        seconds = [one for one in (self.processor_seconds, other.processor_seconds) if one is not None]
        peaks = [one for one in (self.peak, other.peak) if one is not None]
        return Cost(sum(seconds) if seconds else None, max(peaks, default=None))


@dataclass(frozen=True)
class Ended:
    """Outcome of a command: its JSON output, its last sentence, and the cost of all attempts."""

    code: int
    data: dict[str, Any]
    says: str
    seconds: float
    attempts: int = 1
    cost: Cost = Cost()


def run(share: Share, words: Sequence[str]) -> Ended:
    """Run `rig` with these words and `--json` to its end; again where its process was killed."""
    began = time.monotonic()
    attempt = 1
    code, out, err, cost = _once(share, words)
    while code < 0 and attempt < ATTEMPTS:
        attempt += 1
        code, out, err, again = _once(share, words)
        cost += again
    try:
        data = json.loads(out)
    except ValueError:
        data = {}
    says = next((line for line in reversed(err.splitlines()) if line.strip()), "")
    if code < 0:
        says = f"its process was killed {attempt} times ({signal.Signals(-code).name})."
    return Ended(code, data, says, time.monotonic() - began, attempt, cost)


def _once(share: Share, words: Sequence[str]) -> tuple[int, str, str, Cost]:
    """Return exit code, standard output, standard error and cost of one attempt."""
    # Files, not pipes: communicate() would wait for the process itself, and its usage would be lost.
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        # A node of a cluster has given memory to the task, not to a process that stays.
        once = forks.run if sys.platform == "linux" and not share.serves else _started
        code, usage = once(share, [*words, "--json"], out, err)
        texts = []
        for file in (out, err):
            file.seek(0)
            texts.append(file.read().decode(errors="replace"))
    unit = 1 if sys.platform == "darwin" else 1024
    cost = Cost() if usage is None else Cost(usage.ru_utime + usage.ru_stime, usage.ru_maxrss * unit)
    return code, texts[0], texts[1], cost


def _started(share: Share, words: Sequence[str], out: IO[bytes], err: IO[bytes]) -> "forks.Ending":
    """Run as `forks.run`, by a Python of its own."""
    process = subprocess.Popen(
        [sys.executable, "-m", "rig", *words],
        stdin=subprocess.DEVNULL,
        stdout=out,
        stderr=err,
        env=forks.environment_of(share),
    )
    try:
        share.pin(process.pid)
        if not hasattr(os, "wait4"):
            return process.wait(), None
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    except BaseException:
        process.kill()
        process.wait()
        raise
    return process.returncode, usage


@dataclass
class RayWorkers:
    """Processes on the nodes of a Ray cluster, which see the sessions at the same paths.

    cores: of a node, that a task takes; its memory is that of its forecast, and it takes one GPU if it
    wants one and the cluster has any. InputError: no node has that many cores.
    """

    address: str
    cores: int
    room: int = field(init=False)
    at_once: int = field(init=False)
    beside: int = field(init=False)
    _stack: ExitStack = field(default_factory=ExitStack)

    def __post_init__(self) -> None:
        self._ray = self._stack.enter_context(joined(self.address))
        nodes = [node["Resources"] for node in self._ray.nodes() if node["Alive"]]
        self._gpus = int(any(node.get("GPU", 0) >= 1 for node in nodes))
        nodes = [node for node in nodes if node.get("GPU", 0) >= self._gpus]
        if (most := max((node.get("CPU", 0) for node in nodes), default=0)) < self.cores:
            self.close()
            raise InputError(
                f"No node of the Ray cluster at {self.address} that can train has {self.cores} cores: "
                f"give --cores {most:g} or fewer."
            )
        nodes = [node for node in nodes if node.get("CPU", 0) >= self.cores]
        places = [int(min(node["CPU"] // self.cores, node.get("GPU", math.inf))) for node in nodes]
        self.room = int(max(node.get("memory", 0) for node in nodes))
        self.at_once, self.beside = sum(places), max(places)
        self._call = self._ray.remote(_called)

    def submit(
        self, task: Task, function: Callable[Concatenate[Share, P], T], *arguments: P.args, **named: P.kwargs
    ) -> "Future[T]":
        """Submit as `Workers.submit`, on any node with room; again on another if its node is lost.

        InputError in the future: no node has so much memory.
        """
        future: Future[T] = Future()
        if task.memory > self.room:
            future.set_exception(
                InputError(
                    f"It takes about {memory.text(task.memory)} of memory, and no node of the Ray cluster at "
                    f"{self.address} has more than {memory.text(self.room)}: add one that has."
                )
            )
            return future
        call = self._call.options(
            num_cpus=self.cores,
            num_gpus=self._gpus * task.gpu,
            memory=task.memory,
            max_retries=ATTEMPTS - 1,
            retry_exceptions=False,
        )
        share = Share(cores=self.cores, room=self.room, serves=True)
        reference = call.remote(function, share, arguments, named)
        reference.future().add_done_callback(lambda done: self._pass_on(done, future))
        return future

    def _pass_on(self, done: "Future[T]", future: "Future[T]") -> None:
        """The end of a call, whose errors are those of the function, or WorkerLost."""
        errors = self._ray.exceptions
        try:
            future.set_result(done.result())
        except errors.RayTaskError as error:
            future.set_exception(error.cause)
        except errors.RayError:
            future.set_exception(
                WorkerLost(f"the node that ran it was lost {ATTEMPTS} times, or its process was killed.")
            )
        except BaseException as error:
            future.set_exception(error)

    def close(self) -> None:
        """Leave the cluster; what is running there is stopped."""
        self._stack.close()


@contextmanager
def begun(count: int, address: str | None, cores: int) -> Iterator[Workers]:
    """Make workers until the block ends: a number on this machine, or those of a Ray cluster at an
    address.
    """
    workers: Workers
    if address is None:
        from recon.train.devices.training_device import gpus

        workers = LocalWorkers(count, gpus())
    else:
        workers = RayWorkers(address, cores)
    try:
        yield workers
    finally:
        workers.close()


def _called(function: Callable[..., T], share: Share, arguments: Sequence[Any], named: dict[str, Any]) -> T:
    """Run on a node."""
    return function(share, *arguments, **named)

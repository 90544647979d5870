"""A host that joins a Ray cluster as a node, by Ray's own command."""

import json
import os
import signal
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from capture.nodes.cluster import require_answer, require_ray, resource_of
from capture.nodes.place import VARIABLE, NodeSettings
from imaging.errors import CaptureError, InputError

LEAVE = 15.0
"""Seconds that Ray is given to end its processes."""
_STARTED = "Ray runtime started"
_TOLD = 20
"""Lines of Ray's output among which the reason is looked for why it did not start."""


class JoinedNode:
    """The processes of Ray on this host, which start the actors of captures."""

    def __init__(self, process: "subprocess.Popen[str]") -> None:
        self._process = process
        self._lines: deque[str] = deque(maxlen=_TOLD)
        self._started, self._ended = threading.Event(), threading.Event()
        threading.Thread(target=self._listen, daemon=True, name="ray start").start()

    def wait_for_start(self) -> None:
        """CaptureError: Ray did not start, with the last line that looks like a reason."""
        self._started.wait()
        if self._ended.is_set():
            reasons = (
                [line for line in self._lines if "Error" in line] or [*self._lines] or ["it said nothing"]
            )
            raise CaptureError(f"Ray did not start here ({reasons[-1].rstrip('.')}): see ray start --help.")

    def wait_for_end(self) -> None:
        """Return when the cluster is gone."""
        self._ended.wait()

    def leave(self) -> None:
        """End the processes; what cannot be ended in time is killed."""
        with suppress(ProcessLookupError):
            self._process.terminate()
        try:
            self._process.wait(LEAVE)
        except subprocess.TimeoutExpired:
            with suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)

    def _listen(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            if line.strip():
                self._lines.append(line.strip())
            if _STARTED in line:
                self._started.set()
        self._ended.set()
        self._started.set()


@contextmanager
def joined_as(settings: NodeSettings, address: str) -> Iterator[JoinedNode]:
    """This host as a node of the cluster whose head is at `HOST:PORT`, until the block ends.

    InputError: Ray is not installed, or nobody answers there. CaptureError: Ray did not start.
    """
    require_ray()
    try:
        require_answer(address)
    except OSError as error:
        what = (error.strerror or str(error)).lower()
        raise InputError(
            f"No Ray cluster answers at {address} ({what}): begin one on the host that leads, by "
            f"ray start --head --port {address.rpartition(':')[2]}."
        ) from None
    command = [sys.executable, "-m", "ray.scripts.scripts", "start", "--block", "--disable-usage-stats"]
    command += ["--address", address, "--num-cpus", "1"]
    command += ["--resources", json.dumps({resource_of(settings.name): 1})]
    process = subprocess.Popen(
        command,
        env=os.environ | {VARIABLE: settings.model_dump_json(), "PYTHONUNBUFFERED": "1"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    node = JoinedNode(process)
    try:
        node.wait_for_start()
        yield node
    finally:
        node.leave()

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

from capture.nodes.cluster import HEAD, require_answer, require_ray, resource_of
from capture.nodes.node_settings import VARIABLE, NodeSettings
from capture.nodes.token import MODE, OpenDoor, ask_for_token, make_token
from imaging.errors import CaptureError, InputError

LEAVE = 15.0
"""Seconds that Ray is given to end its processes."""
PATIENT = {"RAY_raylet_start_wait_time_s": "240", "RAY_agent_register_timeout_ms": "240000"}
"""Limits on the start of Ray's daemon and of its agent: loaded hosts and small ones pass Ray's own."""
_STARTED = "Ray runtime started"
_LAST = 20
"""Lines of Ray's output among which the reason is looked for why it did not start."""


SUPERVISOR = """
import ctypes, os, signal, subprocess, sys
parent, seconds, child = int(sys.argv[1]), int(sys.argv[2]), None
def end(*_):
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    signal.alarm(seconds)
    if child is not None:
        child.terminate()
signal.signal(signal.SIGALRM, lambda *_: os.killpg(0, signal.SIGKILL))
signal.signal(signal.SIGTERM, end)
try:
    ctypes.CDLL(None).prctl(1, signal.SIGTERM)
except (OSError, AttributeError):
    pass
if os.getppid() == parent:
    child = subprocess.Popen([sys.executable, *sys.argv[3:]])
    sys.exit(child.wait())
"""
"""Supervisor of a command, which it ends when its parent has ended (PR_SET_PDEATHSIG of Linux).

Ray's processes, in a session of their own, would go on as an orphaned node. Linux sends that signal for each
thread of the parent that had the child in turn, and Ray hangs in its handler at the second: it gets one only.
"""


class JoinedNode:
    """The processes of Ray on this host, which start the actors of captures."""

    def __init__(self, process: "subprocess.Popen[str]") -> None:
        self._process = process
        self._lines: deque[str] = deque(maxlen=_LAST)
        self._started, self._ended = threading.Event(), threading.Event()
        self._listener = threading.Thread(target=self._listen, daemon=True, name="ray start")
        self._listener.start()

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
        self._listener.join(LEAVE)

    def _listen(self) -> None:
        assert self._process.stdout is not None
        with self._process.stdout as output:
            for line in output:
                if line.strip():
                    self._lines.append(line.strip())
                if _STARTED in line:
                    self._started.set()
        self._ended.set()
        self._started.set()


@contextmanager
def joined_as(settings: NodeSettings, address: str) -> Iterator[JoinedNode]:
    """Join this host to the cluster whose head is at `HOST:PORT`, until the block ends.

    Ray's processes end with this one, however it ends. InputError: Ray is not installed, nothing answers
    there, or the cluster asks for no token. CaptureError: Ray did not start. StorageError: the token is
    missing and cannot be written.
    """
    environment = PATIENT | os.environ
    guarded = ask_for_token(environment)
    require_ray()
    try:
        require_answer(address)
    except OSError as error:
        what = (error.strerror or str(error)).lower()
        raise InputError(
            f"No Ray cluster answers at {address} ({what}): begin one on the host that leads, by "
            f"{HEAD} --port {address.rpartition(':')[2]}."
        ) from None
    if guarded:
        make_token()
    door = OpenDoor(address) if guarded else None
    command = [sys.executable, "-c", SUPERVISOR, str(os.getpid()), f"{LEAVE:.0f}"]
    command += ["-m", "ray.scripts.scripts", "start", "--block", "--disable-usage-stats"]
    command += ["--address", address, "--num-cpus", "1"]
    command += ["--resources", json.dumps({resource_of(settings.name): 1})]
    process = subprocess.Popen(
        command,
        env=environment | {VARIABLE: settings.model_dump_json(), "PYTHONUNBUFFERED": "1"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    node = JoinedNode(process)
    try:
        node.wait_for_start()
        if door is not None and door.is_open():
            raise InputError(
                f"The Ray cluster at {address} lets any program on its network run code on its hosts: "
                f"start it with {HEAD}, or set {MODE}=disabled if the whole network is your own."
            )
        yield node
    finally:
        if door is not None:
            door.close()
        node.leave()

"""The supervisor of Ray's processes: one signal for its command, and an end to what does not end."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from capture.nodes.joining import SUPERVISOR

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="PR_SET_PDEATHSIG is Linux's")

COUNTING = """
import signal, time
def counted(*_):
    print("terminated", flush=True)
    global ends
    ends = time.monotonic() + 0.5
ends = time.monotonic() + 60
signal.signal(signal.SIGTERM, counted)
print("ready", flush=True)
while time.monotonic() < ends:
    signal.sigtimedwait([], 0.05)
"""
STUBBORN = (
    "import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('ready', flush=True); signal.pause()"
)


@contextmanager
def supervised(code: str, seconds: int) -> Iterator["subprocess.Popen[str]"]:
    """A command of its own session under the supervisor, which is ready for signals."""
    command = [sys.executable, "-c", SUPERVISOR, str(os.getpid()), str(seconds), "-c", code]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, start_new_session=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        try:
            yield process
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)


def test_a_second_signal_does_not_reach_the_command() -> None:
    """Linux sends one for each thread of the parent that had the child; Ray hangs in its handler at two."""
    with supervised(COUNTING, 30) as process:
        assert process.stdout is not None
        process.terminate()
        assert process.stdout.readline() == "terminated\n"
        process.terminate()
        assert process.stdout.read() == ""
        assert process.wait(30) == 0


def test_a_command_that_does_not_end_is_killed_with_its_group() -> None:
    with supervised(STUBBORN, 1) as process:
        assert process.stdout is not None
        process.terminate()
        assert process.stdout.read() == ""  # both ends of the pipe are closed
        assert process.wait(30) == -signal.SIGKILL


def test_nothing_is_begun_for_a_parent_that_has_ended() -> None:
    command = [sys.executable, "-c", SUPERVISOR, "1", "30", "-c", "print('begun')"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout) == (0, "")

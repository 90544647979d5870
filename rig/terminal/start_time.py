"""Start time of the command, from which a budget of time is counted."""

import os
import time
from pathlib import Path

_started = [time.monotonic()]


def started_at() -> float:
    """The reading of `time.monotonic` when the command was started."""
    return _started[0]


def set_start(process: bool) -> None:
    """A command starts now, or (process) started with this process, whose imports then count."""
    _started[0] = time.monotonic() - (process_age() if process else 0.0)


def process_age() -> float:
    """Seconds since this process began; its processor time where the system does not say."""
    try:
        # Field 22 of proc_pid_stat(5); the name before it may hold spaces.
        ticks = int(Path("/proc/self/stat").read_text().rpartition(")")[2].split()[19])
        uptime = float(Path("/proc/uptime").read_text().split()[0])
        age = uptime - ticks / os.sysconf("SC_CLK_TCK")
    except (OSError, ValueError, IndexError):
        age = time.process_time()
    return max(age, 0.0)

"""The number of processor cores to work with."""

import os

GIVEN = "RIG_CORES"
"""Variable of the environment: cores that this process may keep busy, where several share a machine."""


def available_cores() -> int:
    """Cores that this process may run on; all of the machine where the system does not restrict processes.

    Only Linux reports which cores a process may use.
    """
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    given = os.environ.get(GIVEN, "")
    return max(min(cores, int(given)), 1) if given.isdecimal() else cores

"""How many processor cores there are to work with."""

import os


def available_cores() -> int:
    """Cores that this process may run on; all of the machine where the system does not restrict processes.

    Only Linux tells which cores a process may use.
    """
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1

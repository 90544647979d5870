"""Share of the cores that other work leaves at the moment, and what forecasts make of it."""

import hashlib
import time
from concurrent.futures import ThreadPoolExecutor

BLOCK = bytes(1 << 19)
"""Hashed again and again: some hundred microseconds each time, without Python's lock."""
SECONDS = 0.2
"""Some dozen turns that a scheduler gives a thread."""
ALL = 0.85
"""Share from which on nothing else runs: the system takes a little, and hands threads to cores in turns."""


def if_so(free: float) -> tuple[float, str]:
    """The share of the cores that a forecast counts with, and the condition that it names."""
    if free >= ALL:
        return 1.0, "if nothing else runs here"
    return free, f"if other work leaves {max(100 * free, 1):.0f} % of the cores, as now"


def free_share(threads: int) -> float:
    """Share of the time of `threads` cores that as many threads of this process get now, 0..1."""

    def busy(_: int) -> float:
        used, until = time.thread_time(), time.perf_counter() + SECONDS
        while time.perf_counter() < until:
            hashlib.sha256(BLOCK).digest()
        return time.thread_time() - used

    with ThreadPoolExecutor(threads) as pool:
        began = time.perf_counter()
        used = sum(pool.map(busy, range(threads)))
        took = time.perf_counter() - began
    return min(used / (threads * took), 1.0)

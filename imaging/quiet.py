"""Silence for C libraries that print their own complaints instead of only returning them."""

import ctypes
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

_lock = threading.Lock()
_depth = 0
_kept: dict[int, int] = {}


@contextmanager
def quiet() -> Iterator[None]:
    """Nothing that native code prints inside the block reaches stdout or stderr.

    The descriptors are the process's: what other threads print meanwhile is lost too, so keep
    the block as short as one library call. Blocks of several threads may overlap.
    """
    _enter()
    try:
        yield
    finally:
        _leave()


def _enter() -> None:
    global _depth
    with _lock:
        _depth += 1
        if _depth > 1:
            return
        _flush()
        sink = os.open(os.devnull, os.O_WRONLY)
        try:
            for descriptor in (1, 2):
                with suppress(OSError):  # closed by whoever started us: nothing to silence
                    _kept[descriptor] = os.dup(descriptor)
                    os.dup2(sink, descriptor)
        finally:
            os.close(sink)


def _leave() -> None:
    global _depth
    with _lock:
        _depth -= 1
        if _depth:
            return
        _flush_native()
        for descriptor, kept in _kept.items():
            os.dup2(kept, descriptor)
            os.close(kept)
        _kept.clear()


def _flush() -> None:
    for stream in (sys.stdout, sys.stderr):
        with suppress(AttributeError, OSError, ValueError):  # no stream, a closed one, a broken pipe
            stream.flush()
    _flush_native()


def _flush_native() -> None:
    """Empty C's own buffers, so that what was printed inside the block stays inside."""
    with suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).fflush(None)

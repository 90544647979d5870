"""Silence for libraries that print their complaints instead of only returning them."""

import ctypes
import io
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

_lock = threading.Lock()
_depth = 0
_descriptors: dict[int, int] = {}
_stdout: Any = None


class _Sink(io.TextIOBase):
    """Takes the place of sys.stdout, to which OpenEXR's binding prints in Python."""

    def write(self, text: str, /) -> int:
        return len(text)


@contextmanager
def quiet() -> Iterator[None]:
    """Nothing that is printed inside the block reaches stdout or stderr, natively or from Python.

    Both belong to the process: what other threads print meanwhile is lost too, so keep the block
    as short as one library call. Blocks of several threads may overlap.
    """
    _enter()
    try:
        yield
    finally:
        _leave()


def _enter() -> None:
    global _depth, _stdout
    with _lock:
        _depth += 1
        if _depth > 1:
            return
        for stream in (sys.stdout, sys.stderr):
            with suppress(AttributeError, OSError, ValueError):  # no stream, a closed one, a broken pipe
                stream.flush()
        _flush_native()
        _stdout, sys.stdout = sys.stdout, _Sink()
        sink = os.open(os.devnull, os.O_WRONLY)
        try:
            for descriptor in (1, 2):
                with suppress(OSError):  # closed by whoever started us: nothing to silence
                    _descriptors[descriptor] = os.dup(descriptor)
                    os.dup2(sink, descriptor)
        finally:
            os.close(sink)


def _leave() -> None:
    global _depth, _stdout
    with _lock:
        _depth -= 1
        if _depth:
            return
        _flush_native()
        for descriptor, kept in _descriptors.items():
            os.dup2(kept, descriptor)
            os.close(kept)
        _descriptors.clear()
        sys.stdout, _stdout = _stdout, None


def _flush_native() -> None:
    """Empty C's own buffers, so that what was printed inside the block stays inside."""
    with suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).fflush(None)

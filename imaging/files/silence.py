"""Silence for libraries that print their complaints instead of only returning them."""

import ctypes
import io
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, redirect_stdout, suppress

STDIN, STDOUT, STDERR = 0, 1, 2

_lock = threading.Lock()
_depth = 0
_diversions = ExitStack()


class _Sink(io.TextIOBase):
    """Takes the place of sys.stdout, to which OpenEXR's binding prints in Python."""

    def write(self, text: str, /) -> int:
        return len(text)


@contextmanager
def quiet() -> Iterator[None]:
    """Suppress what is printed inside the block, natively or from Python, on stdout and stderr.

    Both belong to the process: what other threads print meanwhile is lost too, so keep the block
    as short as one library call. Blocks of several threads may overlap.
    """
    _enter()
    try:
        yield
    finally:
        _leave()


@contextmanager
def diverted(descriptor: int, target: int) -> Iterator[None]:
    """Let a file descriptor lead to `target` until the block ends; nothing if it is closed."""
    try:
        saved = os.dup(descriptor)
    except OSError:
        yield
        return
    try:
        _flush_native()
        os.dup2(target, descriptor)
        yield
    finally:
        # What C has buffered belongs to the block; flushed later it would come out after all.
        _flush_native()
        os.dup2(saved, descriptor)
        os.close(saved)


def _enter() -> None:
    global _depth
    with _lock:
        _depth += 1
        if _depth > 1:
            return
        for stream in (sys.stdout, sys.stderr):
            with suppress(AttributeError, OSError, ValueError):  # no stream, a closed one, a broken pipe
                stream.flush()
        sink = os.open(os.devnull, os.O_WRONLY)
        _diversions.callback(os.close, sink)
        for descriptor in (STDOUT, STDERR):
            _diversions.enter_context(diverted(descriptor, sink))
        _diversions.enter_context(redirect_stdout(_Sink()))


def _leave() -> None:
    global _depth
    with _lock:
        _depth -= 1
        if not _depth:
            _diversions.close()


def _flush_native() -> None:
    """Empty C's own buffers, where the platform lets Python reach them."""
    with suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).fflush(None)

"""Silencing of libraries while a command works: only rig's own lines come out.

A standard stream that is not there, or breaks, takes nothing but the words: the work goes on.
"""

import io
import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, redirect_stderr, redirect_stdout, suppress
from typing import TYPE_CHECKING, TextIO

from imaging.files.silence import STDERR, STDIN, STDOUT, diverted

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer


def debugging() -> bool:
    """Return whether RIG_DEBUG asks for everything that is otherwise kept back."""
    return os.environ.get("RIG_DEBUG", "") not in ("", "0")


@contextmanager
def libraries_silenced() -> Iterator[TextIO]:
    """Send what libraries print, in Python or in C, nowhere; yields the stream for rig's own lines.

    Decoders and solvers write to the file descriptors behind Python's back: without this a damaged
    JPEG would put libjpeg's words on the user's terminal, or into the JSON on standard output.
    With RIG_DEBUG=1 they speak.
    """
    if debugging():
        with _own_stderr() as voice:
            yield voice
        return
    with ExitStack() as stack:
        voice = stack.enter_context(_own_stderr())
        sink = stack.enter_context(open(os.devnull, "w", encoding="utf-8"))
        for descriptor in (STDOUT, STDERR):
            stack.enter_context(diverted(descriptor, sink.fileno()))
        stack.enter_context(redirect_stdout(sink))
        stack.enter_context(redirect_stderr(sink))
        stack.enter_context(warnings.catch_warnings())
        warnings.simplefilter("ignore")
        yield voice


def mend_standard_streams() -> None:
    """Put the null device where a standard stream is closed, and let standard error never fail.

    A daemon, cron or a shell's `2>&-` may leave any of the three closed. The next file that is opened would
    then get its descriptor, and what a library prints would land in that file.
    """
    for descriptor, name in ((STDIN, "stdin"), (STDOUT, "stdout"), (STDERR, "stderr")):
        try:
            os.fstat(descriptor)
        except OSError:
            null = os.open(os.devnull, os.O_RDWR)
            if null != descriptor:
                os.dup2(null, descriptor)
                os.close(null)
            os.set_inheritable(descriptor, True)
        if getattr(sys, name) is None:
            mode = "r" if descriptor == STDIN else "w"
            stream = open(descriptor, mode, encoding="utf-8", closefd=False)  # noqa: SIM115
            setattr(sys, name, stream)
    sys.stderr = unfailing(STDERR, closefd=False)


def silence_stdout() -> None:
    """Let standard output lead nowhere: its reader has gone, and Python would fail again at its own end."""
    with suppress(AttributeError, OSError, ValueError, io.UnsupportedOperation):
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, sys.stdout.fileno())
        os.close(null)


class _Unfailing(io.FileIO):
    """A file that takes what it is given, whether or not that reaches anybody."""

    def write(self, data: "ReadableBuffer", /) -> int:
        """Write, or lose, all of it."""
        unwritten = memoryview(data).cast("B")
        size = len(unwritten)
        with suppress(OSError):  # the reader has gone, the terminal was closed, the disk is full
            while unwritten:
                unwritten = unwritten[super().write(unwritten) or len(unwritten) :]
        return size


def unfailing(descriptor: int, closefd: bool = True) -> TextIO:
    """A text stream on a descriptor, whose errors are passed over; a character that it lacks is escaped."""
    raw = _Unfailing(descriptor, "w", closefd=closefd)
    encoding = getattr(sys.stderr, "encoding", None) or "utf-8"
    return io.TextIOWrapper(io.BufferedWriter(raw), encoding, "backslashreplace", line_buffering=True)


@contextmanager
def _own_stderr() -> Iterator[TextIO]:
    """`sys.stderr`, or an unfailing copy of it that stays when descriptor 2 is diverted."""
    if sys.stderr is None:  # a program without a console, such as a window, asked for a command
        with open(os.devnull, "w", encoding="utf-8") as nowhere:
            yield nowhere
        return
    try:
        direct = sys.stderr.fileno() == STDERR
    except (AttributeError, OSError, io.UnsupportedOperation, ValueError):
        direct = False
    if not direct:
        yield sys.stderr
        return
    with suppress(OSError, ValueError):
        sys.stderr.flush()
    with unfailing(os.dup(STDERR)) as voice:
        yield voice

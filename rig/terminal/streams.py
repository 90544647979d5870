"""Who may speak: libraries are silenced while a command works, only rig's own lines come out."""

import io
import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, redirect_stderr, redirect_stdout
from typing import TextIO

from imaging.files.silence import STDERR, STDOUT, diverted


def debugging() -> bool:
    """Whether RIG_DEBUG asks for everything that is otherwise kept back."""
    return os.environ.get("RIG_DEBUG", "") not in ("", "0")


@contextmanager
def libraries_silenced() -> Iterator[TextIO]:
    """Send what libraries print, in Python or in C, nowhere; yields the stream for rig's own lines.

    Decoders and solvers write to the file descriptors behind Python's back: without this a damaged
    JPEG would put libjpeg's words on the user's terminal, or into the JSON on standard output.
    With RIG_DEBUG=1 they speak.
    """
    if debugging():
        yield sys.stderr
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


@contextmanager
def _own_stderr() -> Iterator[TextIO]:
    """`sys.stderr`, or a copy of it that stays when descriptor 2 is diverted."""
    try:
        direct = sys.stderr.fileno() == STDERR
    except (AttributeError, OSError, io.UnsupportedOperation):
        direct = False
    if not direct:
        yield sys.stderr
        return
    sys.stderr.flush()
    with os.fdopen(os.dup(STDERR), "w", encoding=sys.stderr.encoding, errors="backslashreplace") as voice:
        yield voice

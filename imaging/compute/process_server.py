"""The other end of `imaging.compute.processes`, which imports nothing but what it is asked to call."""

import os
import pickle
import signal
import sys
from contextlib import suppress


def serve() -> None:
    """Answer calls, in a process of the pool, until the other end of the pipe closes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the caller gets the error, and ends this
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what is printed is no answer
    with suppress(EOFError, BrokenPipeError):
        while True:
            function, arguments = pickle.load(sys.stdin.buffer)
            try:
                answer = True, function(*arguments)
            except Exception as error:
                answer = False, error
            try:
                sent = pickle.dumps(answer)
            except Exception:  # the caller makes the call itself
                return
            answers.write(sent)
            answers.flush()

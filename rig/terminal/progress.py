"""Progress on standard error: a live line on a terminal, a plain line now and then elsewhere.

Stages call `progress(message, done, total)`; total 0 means that the length is not known. The line
is drawn by a thread, so that it moves while a stage is silent.
"""

import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import Protocol, TextIO

from rig.terminal.stage import Clock, Stage
from rig.terminal.text import plain

GRACE, INTERVAL = 1.0, 5.0
"""Seconds until the first plain line of a stage, and between two of them."""


class StatusLine(Protocol):
    """Status display of a command: a line that changes, and lines that stay."""

    stage: Stage

    def begin(self, name: str) -> None:
        """Start a stage, its clock at zero."""
        ...

    def __call__(self, message: str, done: int, total: int) -> None:
        """Show where the stage is: `done` of `total`; total 0 if the length is not known."""
        ...

    def say(self, line: str) -> None:
        """Print a line that stays."""
        ...

    def ask(self, line: str) -> None:
        """Print what a person has to do, even with --quiet."""
        ...


@dataclass
class PlainStatusLine:
    """Lines for logs: one `grace` seconds after a stage began, then one every `interval` seconds.

    They come even if the stage says nothing, so that a silent stage does not look like a dead one;
    a stage that fails at once leaves only its error. `tick` is called by a thread (or a test).
    """

    stream: TextIO
    clock: Clock = time.monotonic
    interval: float = INTERVAL
    grace: float = GRACE
    stage: Stage = field(init=False)
    due: float = field(init=False, default=0.0)
    lock: threading.Lock = field(default_factory=threading.Lock, repr=False)

    def __post_init__(self) -> None:
        self.stage = Stage(self.clock)

    def begin(self, name: str) -> None:
        """Start a stage."""
        with self.lock:
            self.stage.begin(name)
            self.due = self.clock() + self.grace

    def __call__(self, message: str, done: int, total: int) -> None:
        """Note where the stage is; printed by the next tick that is due."""
        with self.lock:
            self.stage.move(message, done, total)
        self.tick()

    def say(self, line: str) -> None:
        """Print a line that stays."""
        with self.lock:
            self._print(plain(line))

    def ask(self, line: str) -> None:
        """Print what a person has to do."""
        self.say(line)

    def tick(self) -> None:
        """Print the stage if it is time for a line."""
        with self.lock:
            if self.stage.name and self.clock() >= self.due:
                self._print(self.stage.line())
                self.due = self.clock() + self.interval

    def _print(self, line: str) -> None:
        self.stream.write(line + "\n")
        self.stream.flush()


@dataclass
class SilentStatusLine:
    """Status display that shows nothing: with --quiet, and in all but the first of several processes of
    torchrun.

    stream: for questions to a person nevertheless, or None.
    """

    stream: TextIO | None = None
    stage: Stage = field(default_factory=lambda: Stage(time.monotonic))

    def begin(self, name: str) -> None:
        """Start a stage."""
        self.stage.begin(name)

    def __call__(self, message: str, done: int, total: int) -> None:
        """Note where the stage is."""
        self.stage.move(message, done, total)

    def say(self, line: str) -> None:
        """Ignore the line."""

    def ask(self, line: str) -> None:
        """Print what a person has to do."""
        if self.stream is not None:
            self.stream.write(plain(line) + "\n")
            self.stream.flush()


def is_main_process() -> bool:
    """Return whether this process prints and writes: of several that torchrun started, the first does."""
    return os.environ.get("RANK", "0") == "0"


_QUIET: ContextVar[bool] = ContextVar("quiet", default=False)


@contextmanager
def silenced(quiet: bool) -> Iterator[None]:
    """Suppress the status within the block, if `quiet`."""
    before = _QUIET.set(quiet)
    try:
        yield
    finally:
        _QUIET.reset(before)


@contextmanager
def status_line(stream: TextIO) -> Iterator[StatusLine]:
    """A status on `stream`, drawn until the block ends: live if it is a terminal, else plain lines."""
    if not is_main_process():
        yield SilentStatusLine()
        return
    if _QUIET.get():
        yield SilentStatusLine(stream)
        return
    if stream.isatty() and os.environ.get("TERM") not in ("dumb", "unknown"):
        from rig.terminal.live_line import (
            live_status_line,  # brings rich's progress bars, which a log does not need
        )

        with live_status_line(stream) as live:
            yield live
        return
    status, over = PlainStatusLine(stream, grace=GRACE), threading.Event()

    def beat() -> None:
        while not over.wait(0.5):
            status.tick()

    drawer = threading.Thread(target=beat, name="rig-progress", daemon=True)
    drawer.start()
    try:
        yield status
    finally:
        over.set()
        drawer.join()

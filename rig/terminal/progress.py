"""Progress on standard error: a live line on a terminal, a plain line now and then elsewhere.

Stages call `progress(message, done, total)`; total 0 means that the length is not known. The line
is drawn by a thread, so that it moves while a stage is silent.
"""

import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Protocol, TextIO

from rig.terminal.position import Clock, Position
from rig.terminal.text import plain

GRACE, INTERVAL = 1.0, 5.0
"""Seconds until the first plain line of a stage, and between two of them."""


Progress = Callable[[str, int, int], None]
"""What a stage calls: message, done, total."""


def unreported(message: str, done: int, total: int) -> None:
    """For those who do not want to know."""


class Meter(Protocol):
    """What a command reports to while it works."""

    def begin(self, stage: str) -> None:
        """A stage starts; its clock starts at zero."""
        ...

    def __call__(self, message: str, done: int, total: int) -> None:
        """Where the stage is: `done` of `total`; total 0 if nobody knows."""
        ...

    def say(self, line: str) -> None:
        """A line that stays."""
        ...


@dataclass
class PlainMeter:
    """Lines for logs: one `grace` seconds after a stage began, then one every `interval` seconds.

    They come even if the stage says nothing, so that a silent stage can be told from a dead one;
    a stage that fails at once leaves only its error. `tick` is called by a thread (or a test).
    """

    stream: TextIO
    clock: Clock = time.monotonic
    interval: float = INTERVAL
    grace: float = GRACE
    position: Position = field(init=False)
    due: float = field(init=False, default=0.0)
    lock: threading.Lock = field(default_factory=threading.Lock, repr=False)

    def __post_init__(self) -> None:
        self.position = Position(self.clock)

    def begin(self, stage: str) -> None:
        """Start a stage."""
        with self.lock:
            self.position.begin(stage)
            self.due = self.clock() + self.grace

    def __call__(self, message: str, done: int, total: int) -> None:
        """Note where the stage is; printed by the next tick that is due."""
        with self.lock:
            self.position.move(message, done, total)
        self.tick()

    def say(self, line: str) -> None:
        """Print a line that stays."""
        with self.lock:
            self._print(plain(line))

    def tick(self) -> None:
        """Print the position if it is time for a line."""
        with self.lock:
            if self.position.stage and self.clock() >= self.due:
                self._print(self.position.line())
                self.due = self.clock() + self.interval

    def _print(self, line: str) -> None:
        self.stream.write(line + "\n")
        self.stream.flush()


@dataclass
class SilentMeter:
    """For those who have nothing to say."""

    def begin(self, stage: str) -> None:
        """Nothing."""

    def __call__(self, message: str, done: int, total: int) -> None:
        """Nothing."""

    def say(self, line: str) -> None:
        """Nothing."""


def speaks() -> bool:
    """Whether this process tells of its work: of several that torchrun started, the first does."""
    return os.environ.get("RANK", "0") == "0"


@contextmanager
def metering(stream: TextIO) -> Iterator[Meter]:
    """A meter on `stream`, drawn until the block ends: live if it is a terminal, else plain lines."""
    if not speaks():
        yield SilentMeter()
        return
    if stream.isatty() and os.environ.get("TERM") not in ("dumb", "unknown"):
        from rig.terminal.live import live_meter  # brings rich's progress bars, which a log does not need

        with live_meter(stream) as live:
            yield live
        return
    meter, over = PlainMeter(stream, grace=GRACE), threading.Event()

    def beat() -> None:
        while not over.wait(0.5):
            meter.tick()

    drawer = threading.Thread(target=beat, name="rig-progress", daemon=True)
    drawer.start()
    try:
        yield meter
    finally:
        over.set()
        drawer.join()

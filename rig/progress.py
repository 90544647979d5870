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

from rig.words import duration, plain

Clock = Callable[[], float]

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
class Position:
    """Where a stage is, and how long it will go on at the pace so far."""

    clock: Clock
    stage: str = ""
    message: str = "starting"
    done: int = 0
    total: int = 0
    began: float = 0.0
    pace_from: tuple[float, int] = (0.0, 0)
    moved: float = 0.0

    def begin(self, stage: str) -> None:
        """Start a stage from nothing."""
        self.stage, self.message, self.done, self.total = stage, "starting", 0, 0
        self.began = self.clock()
        self.pace_from = (self.began, 0)

    def move(self, message: str, done: int, total: int) -> None:
        """Take over a report; a new length or a step back is a new part with a pace of its own."""
        if total != self.total or done < self.done:
            self.pace_from = (self.clock(), done)
        self.message, self.done, self.total = message, done, total
        self.moved = self.clock()

    def elapsed(self) -> float:
        """Seconds since the stage began."""
        return self.clock() - self.began

    def remaining(self) -> float | None:
        """Seconds that this part will still take; None while there is nothing to tell it from.

        The pace is that up to the last report: it does not fall while the next one is under way.
        """
        since, done = self.pace_from
        spent, made = self.moved - since, self.done - done
        if self.total <= 0 or made <= 0 or spent < 1.0:
            return None
        return max(spent / made * (self.total - self.done) - (self.clock() - self.moved), 0.0)

    def counted(self) -> str:
        """`3/24`, or nothing where the length is not known."""
        return f"{self.done}/{self.total}" if self.total > 0 else ""

    def line(self) -> str:
        """The whole position as plain text."""
        parts = [f"{self.stage}: {plain(self.message)}", self.counted(), duration(self.elapsed())]
        left = self.remaining()
        return ", ".join(part for part in parts if part) + (f", {duration(left)} left" if left else "")


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
        from rig.live import live_meter

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

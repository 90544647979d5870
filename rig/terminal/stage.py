"""Progress of a stage, and the time left at the pace so far."""

from collections.abc import Callable
from dataclasses import dataclass

from rig.terminal.text import duration, plain

Clock = Callable[[], float]


@dataclass
class Stage:
    """Progress of a stage, and the time left at the pace so far."""

    clock: Clock
    name: str = ""
    message: str = "starting"
    done: int = 0
    total: int = 0
    began: float = 0.0
    pace_from: tuple[float, int] = (0.0, 0)
    moved: float = 0.0

    def begin(self, name: str) -> None:
        """Start a stage from nothing."""
        self.name, self.message, self.done, self.total = name, "starting", 0, 0
        self.began = self.clock()
        self.pace_from = (self.began, 0)

    def move(self, message: str, done: int, total: int) -> None:
        """Take over a report; a new length, or a step back, begins a part with a pace of its own."""
        if total != self.total or done < self.done:
            self.pace_from = (self.clock(), done)
        self.message, self.done, self.total = message, done, total
        self.moved = self.clock()

    def elapsed(self) -> float:
        """Seconds since the stage began."""
        return self.clock() - self.began

    def remaining(self) -> float | None:
        """Seconds that this part will still take; None while nothing says so yet.

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
        """The whole stage as plain text."""
        parts = [f"{self.name}: {plain(self.message)}", self.counted(), duration(self.elapsed())]
        remaining = self.remaining()
        return ", ".join(part for part in parts if part) + (
            f", {duration(remaining)} left" if remaining else ""
        )

"""The clock of a simulated host, which is ahead of another one, and jumps."""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager

from drivers.clock import Clock


class JumpingClock:
    """Clock ahead of another, which keeps the time. ahead: s; jumps: when on the other clock, and by how far,
    s; ascending.
    """

    def __init__(self, clock: Clock, ahead: float = 0.0, jumps: Sequence[tuple[float, float]] = ()) -> None:
        self._clock, self._ahead, self._jumps = clock, ahead, jumps

    @property
    def lock(self) -> AbstractContextManager[object]:
        """The other's."""
        return self._clock.lock

    def ahead_at(self, moment: float) -> float:
        """Seconds that it is ahead at a time of the other clock."""
        return self._ahead + sum(by for at, by in self._jumps if at <= moment)

    def now(self) -> float:
        """Seconds; a jump may set it back."""
        moment = self._clock.now()
        return moment + self.ahead_at(moment)

    def sleep(self, seconds: float) -> None:
        """Wait that long."""
        self._clock.sleep(seconds)

    def wait(self, ready: Callable[[], bool], seconds: float) -> bool:
        """Wait until `ready()` or that long."""
        return self._clock.wait(ready, seconds)

    def changed(self) -> None:
        """Wake waiting threads, which evaluate their conditions again."""
        self._clock.changed()

    def worker(self, name: str) -> AbstractContextManager[object]:
        """A thread's place on the other clock."""
        return self._clock.worker(name)

"""Comparison of another host's clock with ours by round trips.

The remote time in an answer lies between our times of the question and of the answer (Cristian,
"Probabilistic clock synchronization", 1989): half the round trip is the most by which the middle can be
wrong, whatever the way there and back took. The shortest of several is the sharpest.
"""

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from drivers.clock import Clock

QUESTIONS = 8
"""Round trips of a comparison."""
EVERY = 1.0
"""Seconds after which clocks are compared anew."""
DRIFT = 2e-4
"""Seconds a second by which two clocks may run apart: quartz is within 1e-4, one that is being set more."""
COMPARISONS = 32
"""Comparisons of which the sharpest counts: beyond these drift has made any of them blunt."""


@dataclass(frozen=True)
class ClockReading:
    """A moment on both clocks. at: ours, s; offset: how far the other is ahead, s; error: at most, s."""

    at: float
    offset: float
    error: float

    def aged(self, now: float) -> "ClockReading":
        """Return what it is worth at another time."""
        return ClockReading(now, self.offset, self.error + DRIFT * abs(now - self.at))


class ComparedClock:
    """The clock of another host, on ours; for any thread. ask: the time there, s."""

    def __init__(self, ask: Callable[[], float], clock: Clock) -> None:
        self._ask, self._clock = ask, clock
        self._readings: deque[ClockReading] = deque(maxlen=COMPARISONS)
        self._lock = threading.Lock()

    def reading(self) -> ClockReading:
        """Current offset of the clocks; compares them anew if it is not known well enough. Errors are those
        of `ask`.
        """
        with self._lock:
            readings = [*self._readings]
        if not readings or self._clock.now() - readings[-1].at > EVERY:
            # Two threads may ask at the same time, rather than one wait for the other.
            readings.append(min((self._question() for _ in range(QUESTIONS)), key=lambda one: one.error))
            with self._lock:
                self._readings.append(readings[-1])
        now = self._clock.now()
        return min((one.aged(now) for one in readings), key=lambda one: one.error)

    def forget(self) -> None:
        """The other host was started again: its clock is another one."""
        with self._lock:
            self._readings.clear()

    def _question(self) -> ClockReading:
        before = self._clock.now()
        there = self._ask()
        after = self._clock.now()
        return ClockReading((before + after) / 2, there - (before + after) / 2, (after - before) / 2)


class Release:
    """Common moment for all cameras that are triggered at about the same time, on our clock; thread-safe.

    An order that is sent ahead reaches every host before the moment, so that neither the delay nor the
    sequence of sending counts.
    """

    AHEAD, LEAST = 0.05, 0.01
    """Seconds from the first call to the moment; and before it, in which no further order can be sent."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._moment = -1e300
        self._lock = threading.Lock()

    def moment(self) -> float:
        """Return the moment for a camera that is triggered now, s."""
        with self._lock:
            now = self._clock.now()
            if now > self._moment - self.LEAST:
                self._moment = now + self.AHEAD
            return self._moment

"""Comparison of another host's clock with ours by round trips.

The remote time in an answer lies between our times of the question and of the answer (Cristian,
"Probabilistic clock synchronization", 1989): half the round trip is the most by which the middle can be
wrong, whatever the way there and back took. The shortest of several is the sharpest.

Two readings that contradict each other, beyond errors and drift, are of a clock that jumped between them:
a monotonic clock is never set, but it stands still while its host or virtual machine sleeps or is moved.
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

    def agrees(self, other: "ClockReading") -> bool:
        """Return whether one clock that did not jump can have given both."""
        return abs(self.offset - other.offset) <= self.error + other.aged(self.at).error

    def covering(self, other: "ClockReading") -> "ClockReading":
        """Return a reading that is right before a jump and after it."""
        low = min(self.offset - self.error, other.offset - other.error)
        high = max(self.offset + self.error, other.offset + other.error)
        return ClockReading(other.at, (low + high) / 2, (high - low) / 2)


class ComparedClock:
    """The clock of another host, on ours; for any thread. ask: the time there, s; jumped: takes the size
    of each jump, s, once.
    """

    def __init__(
        self, ask: Callable[[], float], clock: Clock, jumped: Callable[[float], None] = lambda by: None
    ) -> None:
        self._ask, self._clock, self._jumped = ask, clock, jumped
        self._readings: deque[ClockReading] = deque(maxlen=COMPARISONS)
        self._lock = threading.Lock()

    def reading(self) -> ClockReading:
        """Current offset of the clocks. One question tells whether it still holds; compares them anew if not,
        or if it is not known well enough. Errors are those of `ask`.
        """
        with self._lock:
            readings = [*self._readings]
        # Two threads may ask at the same time, rather than one wait for the other.
        if not readings or self._clock.now() - readings[-1].at > EVERY or not self._holds(readings[-1]):
            self._add(min((self._question() for _ in range(QUESTIONS)), key=lambda one: one.error))
            with self._lock:
                readings = [*self._readings]
        now = self._clock.now()
        return min((one.aged(now) for one in readings), key=lambda one: one.error)

    def since(self, earlier: ClockReading) -> ClockReading:
        """Return an earlier reading if the clock has not jumped since, else one that covers the jump."""
        now = self.reading()
        return earlier if now.agrees(earlier) else earlier.covering(now)

    def forget(self) -> None:
        """The other host was started again: its clock is another one, which is no jump."""
        with self._lock:
            self._readings.clear()

    def _holds(self, reading: ClockReading) -> bool:
        return self._question().agrees(reading)

    def _add(self, reading: ClockReading) -> None:
        """Keep a reading, and none that it contradicts: these are of the clock before it jumped."""
        with self._lock:
            before = self._readings[-1] if self._readings else None
            jumped = before is not None and not reading.agrees(before)
            if before is not None and jumped and before.at > reading.at:
                return  # another thread has seen the jump already
            if jumped:
                self._readings.clear()
            self._readings.append(reading)
        if before is not None and jumped:
            self._jumped(reading.offset - before.offset)

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

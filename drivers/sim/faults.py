"""Faults of a simulated camera: planned, or drawn with a seed.

A device asks its plan at every operation, `plan.strike(serial, operation, able)`, and acts on the answer.
Draws depend on (seed, serial, operation, nth time) alone, so neither threads nor other cameras change them.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum

from drivers.clock import Clock
from drivers.sim.seeds import generator

EVERY = "*"
"""Any camera, or any operation."""


class Kind(Enum):
    """A kind of fault, and which fields of `Fault` say how much of it."""

    BUSY = "busy"
    """Answers that it is busy for `seconds`, or `count` times if that is given."""
    BULB = "bulb release busy"
    """A Nikon's shutter is open for `seconds`, as somebody left it: DeviceReady says so."""
    LOST_EVENT = "lost event"
    """The first `count` events of the operation (at least one) are never sent."""
    LATE_EVENT = "late event"
    """Events come `seconds` late."""
    REORDERED_EVENTS = "reordered events"
    """Events come in the opposite order."""
    STALL = "stall"
    """The endpoint halts instead of the answer."""
    TIMEOUT = "time-out"
    """No answer at all; the operation is not done."""
    TRUNCATED = "truncated data"
    """Only `count` bytes of the data come, then the answer."""
    WRONG_TRANSACTION = "wrong transaction id"
    """The answer carries the id of another transaction."""
    UNPLUG = "unplug"
    """The cable comes out after `count` bytes of the answer and is back `seconds` later."""
    EXPOSURE_OFF = "exposure off"
    """The shutter opens for 1 + `share` times what is set, to the nearest time there is; the file says so."""
    STORE_FULL = "store full"
    """Storage is full until something is deleted."""
    SLOW_CARD = "slow card"
    """Storing takes `seconds` longer."""
    SPLIT_HEADER = "header split from payload"
    """The header of the data comes in a transfer of its own."""
    MERGED_RESPONSE = "response merged into data"
    """The response comes in the transfer of the data."""
    NO_RESPONSE = "missing response"
    """The data come, and no response after them, as from a Canon EOS R5 Mark II."""
    FREEZE = "freeze"
    """The operation is done and not answered, nor is any other for `seconds`; then it has begun anew."""
    NO_TRAILER = "missing trailer"
    """The stream's trailer is never sent."""
    DROPPED_PAYLOAD = "dropped payload"
    """`count` bytes of the payload are missing."""
    FEWER_ROWS = "fewer rows"
    """A frame of variable height ends after `count` rows, as its trailer says."""
    CORRUPT_LENGTH = "corrupt length"
    """The length that the answer claims is off by `count`."""


EVENT_FAULTS = frozenset({Kind.LOST_EVENT, Kind.LATE_EVENT, Kind.REORDERED_EVENTS})
CAPTURE_FAULTS = EVENT_FAULTS | {Kind.EXPOSURE_OFF, Kind.STORE_FULL, Kind.SLOW_CARD}


@dataclass(frozen=True)
class Fault:
    """One fault: at the `nth` time that camera `serial` is asked for `operation`; see `Kind`.

    nth: from 1; 0 is every time.
    """

    kind: Kind
    serial: str = EVERY
    operation: str = EVERY
    nth: int = 1
    seconds: float = 0.0
    count: int = 0
    share: float = 0.0

    def __str__(self) -> str:
        amounts = (
            (f"{1000 * self.seconds:.0f} ms", self.seconds),
            (str(self.count), self.count),
            (f"{self.share:+.0%}", self.share),
        )
        return " ".join((self.kind.value, *(text for text, amount in amounts if amount)))


@dataclass(frozen=True)
class Happened:
    """A fault as it happened; time in seconds of the clock."""

    time: float
    serial: str
    operation: str
    nth: int
    fault: Fault


_OF_BYTES = frozenset({Kind.TRUNCATED, Kind.UNPLUG, Kind.DROPPED_PAYLOAD, Kind.CORRUPT_LENGTH})
_MOST_BYTES = 4096
"""Kinds whose count is in bytes, and below how many they are drawn."""


@dataclass(frozen=True)
class Mix:
    """Faults drawn at random: of all operations a `share`, and which, by weight; seconds are the longest."""

    share: float
    weights: Mapping[Kind, float]
    busy: float = 0.1
    late: float = 0.5
    away: float = 0.5

    def draw(self, seed: int, serial: str, operation: str, nth: int, able: frozenset[Kind]) -> Fault | None:
        """The fault of that operation, of a kind that it is able to have; None for most."""
        kinds = [kind for kind in Kind if kind in able and self.weights.get(kind, 0.0) > 0.0]
        dice = generator(seed, serial, "fault", operation, nth)
        if not kinds or dice.random() >= self.share:
            return None
        weights = [self.weights[kind] for kind in kinds]
        kind = kinds[int(dice.choice(len(kinds), p=[weight / sum(weights) for weight in weights]))]
        longest = {Kind.BUSY: self.busy, Kind.LATE_EVENT: self.late, Kind.UNPLUG: self.away}.get(kind, 0.0)
        seconds = round(longest * float(dice.random()), 6)
        count = int(dice.integers(1, _MOST_BYTES)) if kind in _OF_BYTES else 0
        return Fault(kind, serial, operation, nth, seconds, count)


ROUGH = Mix(
    0.05,
    {
        Kind.BUSY: 0.80,
        Kind.LOST_EVENT: 0.075,
        Kind.LATE_EVENT: 0.075,
        Kind.STALL: 0.04,
        Kind.UNPLUG: 0.005,
        Kind.TIMEOUT: 0.005,
    },
)
"""A twentieth of all operations goes wrong: mostly busy, some events lost or late."""


@dataclass
class FaultPlan:
    """Planned faults, and the log of those that occurred."""

    clock: Clock
    faults: Sequence[Fault] = ()
    mix: Mix | None = None
    seed: int = 0
    log: list[Happened] = field(default_factory=list)
    _counts: Counter[tuple[str, str]] = field(default_factory=Counter)

    def strike(self, serial: str, operation: str, able: frozenset[Kind]) -> tuple[Fault, ...]:
        """Count the operation and say what goes wrong with it; only kinds in `able` can.

        A script's `nth` counts the camera's operations of that name; all of them for EVERY.
        """
        counts = self._counts
        counts[serial, operation] += 1
        counts[serial, EVERY] += 1
        nth = counts[serial, operation]
        struck = [
            fault for fault in self.faults if fault.kind in able and self._hits(fault, serial, operation)
        ]
        if self.mix is not None:
            drawn = self.mix.draw(self.seed, serial, operation, nth, able)
            struck += [] if drawn is None else [drawn]
        self.log += [Happened(self.clock.now(), serial, operation, nth, fault) for fault in struck]
        return tuple(struck)

    def operations(self) -> int:
        """Return how many operations there were."""
        return sum(count for (_, operation), count in self._counts.items() if operation == EVERY)

    def _hits(self, fault: Fault, serial: str, operation: str) -> bool:
        if fault.serial not in (EVERY, serial) or fault.operation not in (EVERY, operation):
            return False
        return fault.nth in (0, self._counts[serial, fault.operation])

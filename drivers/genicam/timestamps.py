"""Shutter openings: a camera's own timestamps, on the clock of the host.

A machine vision camera stamps the leader of each frame with its own clock, such as ns since it was
switched on. That
clock is latched before the frame and again after it, each time between two looks at the host's clock (as in
Cristian, "Probabilistic clock synchronization", 1989: the shortest of several round trips is the sharpest).
The stamp lies between the two, and so does the moment: neither offset nor drift nor unit has to be known.

Names as in SFNC, which drivers of Blackfly S, ace 2 and Alvium
cameras use. Allied Vision says that a stamp is the start of the exposure; other makers do not always say. A
stamp after which the exposure could not have ended is left out. Verified against the simulator.
"""

from collections.abc import Callable
from dataclasses import dataclass

from drivers.clock import Clock
from drivers.errors import CameraBusy, CameraProtocol, CameraRefused, CameraTimeout
from drivers.genicam.nodemap import NodeMap
from drivers.genicam.session import DeviceClock

_TRIES = 5
"""Latches at most, of which the shortest is kept."""
_AS_SHORT = 1.2
"""Times the shortest latch known, up to which one is not tried again: each question is one that can fail."""


@dataclass(frozen=True)
class Latch:
    """A moment on both clocks. host: s; device: in its unit; uncertainty: half the round trip, s."""

    host: float
    device: int
    uncertainty: float


@dataclass(frozen=True)
class Opening:
    """Moment of a shutter's opening: s of the host's clock, right to within `uncertainty` s."""

    time: float
    uncertainty: float


def latch(registers: DeviceClock, nodes: NodeMap, clock: Clock, surest: Latch | None = None) -> Latch | None:
    """The device's clock now, by its registers, or else by its features.

    Args:
        registers: Clock registers of the device.
        nodes: Features of the device.
        clock: Clock of the host.
        surest: Earlier latch; one that is nearly as sure will do.

    Returns:
        The shortest of up to five latches; None if the device has neither registers nor features for it, or
        cannot be asked now.
    """
    enough = 0.0 if surest is None else _AS_SHORT * surest.uncertainty
    try:
        return _shortest(lambda: _latch_register(registers, clock), enough)
    except CameraRefused:
        pass  # Not every device has these registers.
    except (CameraBusy, CameraProtocol, CameraTimeout):
        return None  # No frame is given up for its time.
    try:
        return _shortest(lambda: _latch_feature(nodes, clock), enough)
    except (CameraBusy, CameraProtocol, CameraRefused, CameraTimeout):
        return None


def opening(before: Latch | None, after: Latch | None, stamp: int, exposure: float) -> Opening | None:
    """The moment of a frame's `stamp` between two latches.

    A stamp is wrong if it is not between the latches (it may be 0, old, or of a clock that was set back), and
    if the exposure could not have ended before the second.

    Args:
        before: Latch before the frame, if there is one.
        after: Latch after the frame, if there is one.
        stamp: Timestamp of the frame, in the unit of the device's clock.
        exposure: Exposure time, s.

    Returns:
        The moment on the host's clock; None without two latches, and for a stamp that cannot be right.
    """
    if before is None or after is None or not before.device <= stamp <= after.device:
        return None
    if before.device == after.device:
        return None
    share = (stamp - before.device) / (after.device - before.device)
    time = before.host + share * (after.host - before.host)
    uncertainty = (1 - share) * before.uncertainty + share * after.uncertainty
    if time + exposure > after.host + after.uncertainty + uncertainty:
        return None
    return Opening(time, uncertainty)


def _latch_register(registers: DeviceClock, clock: Clock) -> Latch:
    began = clock.now()
    registers.latch()
    ended = clock.now()
    return Latch((began + ended) / 2, registers.latched(), (ended - began) / 2)


def _latch_feature(nodes: NodeMap, clock: Clock) -> Latch:
    began = clock.now()
    nodes.execute("TimestampLatch")
    ended = clock.now()
    return Latch((began + ended) / 2, int(nodes.number("TimestampLatchValue")), (ended - began) / 2)


def _shortest(attempt: Callable[[], Latch], enough: float) -> Latch:
    best = attempt()
    for _ in range(_TRIES - 1):
        if best.uncertainty <= enough:
            break
        best = min(best, attempt(), key=lambda reading: reading.uncertainty)
    return best

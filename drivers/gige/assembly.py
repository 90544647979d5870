"""Frames put together from packets that may come late, twice, or not at all; no socket, no thread.

A packet that is skipped is asked for again after a moment in which it may still come by itself, and from
then on every 20 ms; so is the end of a frame that falls silent. A frame to which half a second adds nothing
is given up.
"""

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from drivers.errors import CameraProtocol
from drivers.genicam.session import Frame, fewer_rows
from drivers.gige import gvsp
from drivers.gige.gvcp import Resend, Status
from drivers.gige.gvsp import Kind, Leader, PacketHeader

REORDERED = 0.002
"""Seconds in which a packet may be overtaken by others."""
AGAIN = 0.02
"""Seconds between requests for the same packet."""
GIVEN_UP = 0.5
"""Seconds without a new packet after which the rest of a frame does not come."""
_MOST_RANGES = 64
"""Requests at a time: answers to many would overflow what they are to fill."""
_GONE = (Status.UNAVAILABLE, Status.REMOVED, Status.REMOVED_WITH_ALL_BEFORE)
_REMEMBERED, _MOST_AT_ONCE = 64, 8
"""Frames whose late packets are known as such; frames that are put together at a time."""


@dataclass
class _Building:
    """A frame of which packets have come. missing: when each is asked for next; newest: highest number."""

    block: int
    extended: bool
    payload: bytearray
    touched: float
    newest: int = -1
    missing: dict[int, float] = field(default_factory=dict)
    leader: Leader | None = None
    last: int | None = None
    """The number of the trailer, once that has come."""
    rows: int = 0
    """Number of rows in its trailer; 0 if that has none."""
    filled: int = 0
    gone: int = 0
    refused: str | None = None

    @property
    def complete(self) -> bool:
        return self.last is not None and self.leader is not None and not self.missing


class Assembler:
    """Assembler of packets to frames; times are those of any clock, s.

    payload: bytes of a frame at most; packet_size: as set on the device.
    """

    def __init__(self, payload: int, packet_size: int) -> None:
        self._payload, self._packet_size = payload, packet_size
        self._trailer = {
            extended: -(-payload // max(gvsp.room(packet_size, extended), 1)) + 1
            for extended in (False, True)
        }
        """The number of the trailer of a frame of full size."""
        self._building: dict[int, _Building] = {}
        self._done: deque[int] = deque(maxlen=_REMEMBERED)

    def feed(self, data: memoryview, now: float) -> Frame | None:
        """Take a datagram; return the frame that it completes. CameraProtocol if it is invalid."""
        header = PacketHeader.parse(data)
        if header.block in self._done:
            return None
        building = self._building.get(header.block)
        if building is None:
            if header.status & 0x8000:
                return None  # about a frame that no caller waits for
            if len(self._building) == _MOST_AT_ONCE:
                del self._building[next(iter(self._building))]  # its turn has long been over
            empty = bytearray(self._payload)
            building = _Building(header.block, header.extended, empty, now)
            self._building[header.block] = building
        number = header.number
        if header.status & 0x8000:
            return self._without(building, number, header.status)
        if number > self._trailer[header.extended]:
            raise CameraProtocol(f"packet {number} of a frame of {self._payload} bytes")
        if number <= building.newest and number not in building.missing:
            return None  # it came before
        carried = data[gvsp.header_size(header.extended) :]
        self._take(building, header, carried)
        building.touched = now
        for skipped in range(building.newest + 1, number):
            building.missing[skipped] = now + REORDERED
        building.missing.pop(number, None)
        building.newest = max(building.newest, number)
        return self._finished(building) if building.complete else None

    def due(self, now: float) -> list[Resend]:
        """Return what is to be asked for now."""
        wanted: list[Resend] = []
        for building in self._building.values():
            if building.last is None and now - building.touched >= AGAIN and not building.missing:
                # Its end does not come: all of it is missing.
                end = self._trailer[building.extended]
                for number in range(building.newest + 1, end + 1):
                    building.missing[number] = now
                building.newest = max(building.newest, end)
            numbers = sorted(number for number, when in building.missing.items() if when <= now)
            for first, last in _ranges(numbers)[:_MOST_RANGES]:
                wanted.append(Resend(building.block, first, last, building.extended))
                for number in range(first, last + 1):
                    building.missing[number] = now + AGAIN
        return wanted

    def given_up(self, now: float) -> list[Frame]:
        """Frames whose rest does not come."""
        late = [one for one in self._building.values() if now - one.touched >= GIVEN_UP]
        return [self._finished(building) for building in late]

    def _take(self, building: _Building, header: PacketHeader, carried: memoryview) -> None:
        if header.kind == Kind.LEADER:
            building.leader = Leader.parse(building.block, carried.tobytes())
        elif header.kind == Kind.TRAILER:
            building.last, building.rows = header.number, gvsp.rows(carried.tobytes())
            # Packets beyond the trailer were only expected.
            building.missing = {one: when for one, when in building.missing.items() if one < header.number}
        elif header.kind == Kind.PAYLOAD:
            start = (header.number - 1) * gvsp.room(self._packet_size, header.extended)
            part = carried[: max(self._payload - start, 0)]
            if start < 0 or not part:
                raise CameraProtocol(f"packet {header.number} has no place in a frame")
            building.payload[start : start + len(part)] = part
            building.filled = max(building.filled, start + len(part))
        else:
            building.refused = f"packets of format {header.kind}"

    def _without(self, building: _Building, number: int, status: int) -> Frame | None:
        """The device says that a packet will not come; what it has not yet is asked for later."""
        if number <= building.newest and number not in building.missing:
            return None
        if number == self._trailer[building.extended] and self._whole(building):
            # Some cameras do not send a trailer again, and nothing but it is missing.
            building.last = number
            building.missing.clear()
            return self._finished(building)
        if status not in _GONE:
            return None
        building.gone += 1
        return self._finished(building)

    def _whole(self, building: _Building) -> bool:
        """Return whether all of a frame of full size has come but its trailer."""
        others = building.missing.keys() - {self._trailer[building.extended]}
        return building.leader is not None and building.filled == self._payload and not others

    def _finished(self, building: _Building) -> Frame:
        del self._building[building.block]
        self._done.append(building.block)
        leader = building.leader or Leader(building.block, gvsp.IMAGE, 0)
        problem = None
        if building.refused is not None:
            problem = f"it comes in {building.refused}"
        elif building.gone:
            problem = "the camera no longer has packets of it that were lost"
        elif not building.complete:
            lost = len(building.missing) + (building.leader is None and 0 not in building.missing)
            problem = f"packets were lost, {max(lost, 1)} at least, and did not come when asked for again"
        elif building.filled < self._payload and 0 < building.rows < leader.height:
            problem = fewer_rows(building.rows, leader.height)
        payload = np.frombuffer(building.payload, np.uint8)[: building.filled]
        return Frame(leader, payload, problem)


def _ranges(numbers: list[int]) -> list[tuple[int, int]]:
    """Runs of numbers that follow on from one another, as the first and the last of each."""
    runs: list[tuple[int, int]] = []
    for number in numbers:
        if runs and number == runs[-1][1] + 1:
            runs[-1] = (runs[-1][0], number)
        else:
            runs.append((number, number))
    return runs

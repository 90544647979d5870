"""Frames from the streaming interface of a USB3 Vision device: leader, payload, trailer."""

import struct
from array import array
from dataclasses import dataclass
from typing import Any

import numpy as np

from drivers.clock import Clock
from drivers.errors import CameraProtocol, CameraRefused, CameraTimeout
from drivers.genicam.chunks import CHUNKS
from drivers.genicam.session import Frame, FrameLeader, fewer_rows
from drivers.u3v.control import ControlChannel
from drivers.u3v.registers import Sirm
from drivers.usb import EndpointStalled, UsbPipe
from imaging.arrays import Bytes

LEADER_MAGIC, TRAILER_MAGIC = b"U3VL", b"U3VT"
IMAGE = 0x0001
"""The payload type of an image."""
_LEADER = struct.Struct("<4sHHQHHQIIIIIHH")
_TRAILER = struct.Struct("<4sHHQHHQI")
LEADER_SIZE, TRAILER_SIZE = _LEADER.size, _TRAILER.size
_LARGEST_TRANSFER = 1 << 20
_LARGEST_PAYLOAD = 1 << 31
_STALE = 1.0
"""Seconds without a byte after which the rest of a frame does not come."""


class Leader(FrameLeader):
    """Header of a frame, whose timestamp is in ns."""

    def pack(self) -> bytes:
        """The 52 bytes."""
        head = (LEADER_MAGIC, 0, LEADER_SIZE, self.block, 0, self.payload_type, self.timestamp)
        image = (self.pixel_format, self.width, self.height, self.left, self.top, self.padding, 0)
        return _LEADER.pack(*head, *image)

    @classmethod
    def parse(cls, data: bytes) -> "Leader | None":
        """Parse the leader at the beginning of `data`, or return None."""
        if len(data) < LEADER_SIZE or data[:4] != LEADER_MAGIC:
            return None
        _, _, _, block, _, kind, timestamp, *image, _ = _LEADER.unpack_from(data)
        return cls(block, kind, timestamp, *image)


@dataclass(frozen=True)
class Trailer:
    """Trailer of a frame. status: 0 on success; valid: valid bytes of payload."""

    block: int
    status: int
    valid: int
    height: int

    def pack(self) -> bytes:
        """The 32 bytes."""
        head = (TRAILER_MAGIC, 0, TRAILER_SIZE, self.block)
        return _TRAILER.pack(*head, self.status, 0, self.valid, self.height)

    @classmethod
    def parse(cls, data: bytes) -> "Trailer | None":
        """Parse the trailer at the beginning of `data`, or return None."""
        if len(data) < TRAILER_SIZE or data[:4] != TRAILER_MAGIC:
            return None
        _, _, _, block, status, _, valid, height = _TRAILER.unpack_from(data)
        return cls(block, status, valid, height)


@dataclass(frozen=True)
class TransferPlan:
    """Division of a payload into USB transfers: `count` of `size` bytes and one of `last`, if not 0."""

    size: int
    count: int
    last: int

    @classmethod
    def of(cls, payload: int, alignment: int) -> "TransferPlan":
        """The plan for a payload; sizes are multiples of `alignment`."""
        size = max(_LARGEST_TRANSFER // alignment * alignment, alignment)
        return cls(size, payload // size, -(-(payload % size) // alignment) * alignment)

    def sizes(self) -> list[int]:
        """The transfers in order."""
        return [self.size] * self.count + ([self.last] if self.last else [])


class StreamChannel:
    """Sets the stream up, and reads frame after frame; errors are those of `UsbPipe` and `ControlChannel`."""

    def __init__(self, pipe: UsbPipe, control: ControlChannel, sirm: int, clock: Clock) -> None:
        self._pipe, self._control, self._sirm, self._clock = pipe, control, sirm, clock
        self._endpoint = pipe.endpoint(into_host=True)
        self._buffers: dict[int, array[int]] = {}
        self._plan = TransferPlan.of(0, 1)
        self._payload = 0
        """Payload bytes for which the device is configured; 0 before."""
        self._early: Leader | None = None
        self._may_send = True

    def start(self) -> None:
        """Agree on transfers as the camera is set now, and let it send; AcquisitionStart comes after."""
        if self._may_send:
            self._enable(False)
        payload = self._control.read_number(self._sirm + Sirm.REQUIRED_PAYLOAD, 8)
        if payload != self._payload:
            self._agree(payload)
        self._pipe.clear_halt(self._endpoint)
        self._early = None
        self._enable(True)

    def stop(self) -> None:
        """Stop the stream; AcquisitionStop comes before."""
        self._enable(False)

    def next_frame(self, timeout: float) -> Frame:
        """The next frame, complete or not, that begins within `timeout` s. CameraTimeout if none does.

        EndpointStalled, which is cleared then, if the camera halted the stream instead.
        """
        leader = self._leader(timeout)
        payload = np.empty(self._payload, np.uint8)
        filled, problem = 0, None
        try:
            for size in self._plan.sizes():
                data = self._read(size, _STALE)
                trailer = self._ending(data, leader)
                if trailer is not None:
                    return self._closed(leader, payload[:filled], trailer)
                if self._early is not None:
                    return Frame(leader, payload[:filled], "its payload broke off")
                part = data[: len(payload) - filled]
                payload[filled : filled + len(part)] = part
                filled += len(part)
                if len(data) < size:
                    break
            data = self._read(_LARGEST_TRANSFER, _STALE)
            trailer = self._ending(data, leader)
            if trailer is not None:
                return self._closed(leader, payload[:filled], trailer)
            self._early = self._last_leader(data)
            problem = "its trailer is missing"
        except CameraTimeout:
            problem = "the rest of it did not come"
        except EndpointStalled:
            self._pipe.clear_halt(self._endpoint)
            problem = "the camera halted the stream"
        except CameraProtocol as error:
            problem = str(error)
        return Frame(leader, payload[:filled], problem)

    def _agree(self, payload: int) -> None:
        """Choose the transfers for frames of that many bytes, and configure the device."""
        number = self._control.read_number
        if not 0 < payload <= _LARGEST_PAYLOAD:
            raise CameraProtocol(f"{self._pipe.where} announces frames of {payload} bytes: reset the camera.")
        alignment = 1 << min(number(self._sirm + Sirm.INFO, 4) >> 24, 20)
        leader = number(self._sirm + Sirm.REQUIRED_LEADER, 4)
        trailer = number(self._sirm + Sirm.REQUIRED_TRAILER, 4)
        self._plan = TransferPlan.of(payload, alignment)
        for register, value in (
            (Sirm.LARGEST_LEADER, -(-leader // alignment) * alignment),
            (Sirm.TRANSFER_SIZE, self._plan.size),
            (Sirm.TRANSFER_COUNT, self._plan.count),
            (Sirm.LAST_TRANSFER, self._plan.last),
            (Sirm.LAST_TRANSFER_2, 0),
            (Sirm.LARGEST_TRAILER, -(-trailer // alignment) * alignment),
        ):
            self._control.write_number(self._sirm + register, 4, value)
        # Only now: what broke off on the way is agreed on anew.
        self._payload = payload

    def _leader(self, timeout: float) -> Leader:
        """The next leader; whatever else comes before it belongs to a frame that is lost."""
        deadline = self._clock.now() + timeout
        while self._early is None:
            remaining = deadline - self._clock.now()
            if remaining <= 0:
                raise CameraTimeout(
                    f"{self._pipe.where} sent no frame within {timeout:.3g} s: check trigger and exposure."
                )
            try:
                self._early = self._last_leader(self._read(_LARGEST_TRANSFER, remaining))
            except EndpointStalled:
                self._pipe.clear_halt(self._endpoint)
                raise
            except CameraTimeout:
                continue
        leader, self._early = self._early, None
        if leader.payload_type & ~CHUNKS != IMAGE:
            raise CameraRefused(
                f"{self._pipe.where} sends payloads of type {leader.payload_type:#06x}, not images."
            )
        return leader

    def _last_leader(self, data: Bytes) -> Leader | None:
        """The leader at the end of `data`: what is left of a payload in whole packets may come before it."""
        if (len(data) - LEADER_SIZE) % (self._endpoint.wMaxPacketSize or 1):
            return None
        return Leader.parse(data[-LEADER_SIZE:].tobytes())

    def _ending(self, data: Bytes, leader: Leader) -> Trailer | None:
        """The frame's trailer if `data` is that; the leader of the next frame is kept for later."""
        if len(data) > 1024:
            return None
        payload = data.tobytes()
        trailer = Trailer.parse(payload)
        if trailer is not None and trailer.block == leader.block:
            return trailer
        if len(data) == LEADER_SIZE:
            self._early = Leader.parse(payload)
        return None

    def _closed(self, leader: Leader, payload: Bytes, trailer: Trailer) -> Frame:
        """A frame with its trailer, judged."""
        problem = None
        if trailer.status:
            problem = f"the camera reports lost parts (status {trailer.status:#06x})"
        elif len(payload) < trailer.valid:
            problem = f"{trailer.valid - len(payload)} bytes of its payload are missing"
        elif trailer.valid < self._payload and 0 < trailer.height < leader.height:
            problem = fewer_rows(trailer.height, leader.height)
        return Frame(leader, payload[: trailer.valid], problem)

    def _read(self, size: int, timeout: float) -> Bytes:
        """One transfer of at most `size` bytes; the array is overwritten by the next."""
        packet = self._endpoint.wMaxPacketSize or 1
        whole = -(-size // packet) * packet
        buffer = self._buffers.get(whole)
        if buffer is None:
            buffer = self._buffers[whole] = array("B", bytes(whole))
        count = self._pipe.read_into(self._endpoint, buffer, timeout)
        view: Any = memoryview(buffer)
        return np.frombuffer(view, np.uint8, count)

    def _enable(self, on: bool) -> None:
        self._may_send = True
        self._control.write_number(self._sirm + Sirm.CONTROL, 4, int(on))
        self._may_send = on

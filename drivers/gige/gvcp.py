"""GVCP, the control protocol of GigE Vision: datagrams in, records out, nothing else.

A command is a key byte 0x42, flags, a code, the payload's size and a request id; an answer has a status in
place of key and flags. All numbers are big endian. Codes as in Aravis and in Wireshark's dissector.
"""

import struct
from dataclasses import dataclass
from enum import IntEnum

from drivers.errors import CameraProtocol

PORT = 3956
"""Port of devices."""
_KEY = 0x42
ACKNOWLEDGE = 0x01
"""The flag of a command that wants an answer."""
BROADCAST_ANSWER, EXTENDED_ID, SCHEDULED = 0x10, 0x10, 0x80
"""Flags of DISCOVERY, of RESEND with frames of 64 bits, and of ACTION with a time."""
_HEADER, _ANSWER = struct.Struct(">BBHHH"), struct.Struct(">HHHH")
HEADER_SIZE = _HEADER.size
MOST_MEMORY = 536
"""Bytes of the largest READMEM and WRITEMEM."""


class Code(IntEnum):
    """Packet type."""

    DISCOVERY = 0x0002
    DISCOVERY_ACK = 0x0003
    RESEND = 0x0040
    READ_REGISTER = 0x0080
    READ_REGISTER_ACK = 0x0081
    WRITE_REGISTER = 0x0082
    WRITE_REGISTER_ACK = 0x0083
    READ_MEMORY = 0x0084
    READ_MEMORY_ACK = 0x0085
    WRITE_MEMORY = 0x0086
    WRITE_MEMORY_ACK = 0x0087
    PENDING_ACK = 0x0089
    EVENT = 0x00C0
    EVENT_ACK = 0x00C1
    EVENT_DATA = 0x00C2
    EVENT_DATA_ACK = 0x00C3
    ACTION = 0x0100
    ACTION_ACK = 0x0101


class Status(IntEnum):
    """Status of a command, or of a packet of the stream."""

    SUCCESS = 0x0000
    RESENT = 0x0100
    NOT_IMPLEMENTED = 0x8001
    INVALID_PARAMETER = 0x8002
    INVALID_ADDRESS = 0x8003
    WRITE_PROTECTED = 0x8004
    BAD_ALIGNMENT = 0x8005
    ACCESS_DENIED = 0x8006
    BUSY = 0x8007
    UNAVAILABLE = 0x800C
    INVALID_HEADER = 0x800E
    NOT_YET_AVAILABLE = 0x8010
    REMOVED_WITH_ALL_BEFORE = 0x8011
    REMOVED = 0x8012
    NO_REFERENCE_TIME = 0x8013
    TEMPORARILY_UNAVAILABLE = 0x8014
    ACTION_LATE = 0x8016


@dataclass(frozen=True)
class Command:
    """A command."""

    code: int
    request_id: int
    payload: bytes = b""
    flags: int = ACKNOWLEDGE

    def pack(self) -> bytes:
        """The datagram."""
        return _HEADER.pack(_KEY, self.flags, self.code, len(self.payload), self.request_id) + self.payload

    @classmethod
    def parse(cls, data: bytes) -> "Command":
        """Parse the command in a datagram. CameraProtocol if it is invalid."""
        if len(data) < HEADER_SIZE:
            raise CameraProtocol(f"a GVCP command of {len(data)} bytes has no header")
        key, flags, code, size, request_id = _HEADER.unpack_from(data)
        if key != _KEY or len(data) - HEADER_SIZE != size:
            raise CameraProtocol("what came is no GVCP command")
        return cls(code, request_id, bytes(data[HEADER_SIZE:]), flags)


@dataclass(frozen=True)
class Answer:
    """Answer of a device."""

    status: int
    code: int
    request_id: int
    payload: bytes = b""

    def pack(self) -> bytes:
        """The datagram."""
        return _ANSWER.pack(self.status, self.code, len(self.payload), self.request_id) + self.payload

    @classmethod
    def parse(cls, data: bytes) -> "Answer":
        """Parse the answer in a datagram. CameraProtocol if it is invalid."""
        if len(data) < HEADER_SIZE:
            raise CameraProtocol(f"a GVCP answer of {len(data)} bytes has no header")
        status, code, size, request_id = _ANSWER.unpack_from(data)
        if len(data) - HEADER_SIZE < size:
            raise CameraProtocol(f"a GVCP answer announces {size} bytes and has {len(data) - HEADER_SIZE}")
        return cls(status, code, request_id, bytes(data[HEADER_SIZE : HEADER_SIZE + size]))


def event_answer(data: bytes) -> bytes | None:
    """Answer to a datagram that states an event; None for other commands and where none is wanted.

    CameraProtocol if it is no command. A device asks again for an answer that does not come.
    """
    command = Command.parse(data)
    if command.code not in (Code.EVENT, Code.EVENT_DATA) or not command.flags & ACKNOWLEDGE:
        return None
    return Answer(Status.SUCCESS, command.code + 1, command.request_id).pack()


def is_command(data: bytes) -> bool:
    """Return whether a datagram is a command of the other side, whose numbers are not those of requests."""
    return data[:1] == bytes([_KEY])


def memory_payload(address: int, size: int) -> bytes:
    """Return what READ_MEMORY asks: `size` bytes from `address`."""
    return struct.pack(">IHH", address, 0, size)


def number_payload(number: int) -> bytes:
    """Return what answers to writes (how much was written) and PENDING_ACK (ms to wait) carry."""
    return struct.pack(">HH", 0, number)


def refusal_payload(code: int) -> bytes:
    """Return what an answer carries that refuses a command: of a write, that nothing was written."""
    return number_payload(0) if code in (Code.WRITE_REGISTER, Code.WRITE_MEMORY) else b""


def parse_number_payload(payload: bytes) -> int:
    """Parse the number in such an answer. CameraProtocol if it is invalid."""
    if len(payload) != 4:
        raise CameraProtocol(f"an answer of {len(payload)} bytes should have 4")
    return int.from_bytes(payload[2:], "big")


@dataclass(frozen=True)
class Resend:
    """Packets of a frame that are to be sent again, `first` to `last`."""

    block: int
    first: int
    last: int
    extended: bool

    def command(self, request_id: int) -> Command:
        """RESEND for stream channel 0; nothing answers it but the packets."""
        if self.extended:
            payload = struct.pack(">HHIIQ", 0, 0, self.first, self.last, self.block)
            return Command(Code.RESEND, request_id, payload, EXTENDED_ID)
        return Command(Code.RESEND, request_id, struct.pack(">HHII", 0, self.block, self.first, self.last), 0)

    @classmethod
    def parse(cls, command: Command) -> "Resend":
        """Parse the command. CameraProtocol if its payload is invalid."""
        extended = bool(command.flags & EXTENDED_ID)
        if len(command.payload) != (20 if extended else 12):
            raise CameraProtocol(f"a RESEND of {len(command.payload)} bytes")
        if extended:
            _, _, first, last, block = struct.unpack(">HHIIQ", command.payload)
        else:
            _, block, first, last = struct.unpack(">HHII", command.payload)
        return cls(block, first & 0xFFFFFFFF, last & 0xFFFFFFFF, extended)


@dataclass(frozen=True)
class Action:
    """Action command, for all devices of this device key and group key whose mask shares a bit.

    time: when, ns of IEEE 1588 time; None: immediately.
    """

    device_key: int
    group_key: int
    group_mask: int
    time: int | None = None

    def command(self, request_id: int, *, acknowledge: bool) -> Command:
        """ACTION."""
        flags = (SCHEDULED if self.time is not None else 0) | (ACKNOWLEDGE if acknowledge else 0)
        payload = struct.pack(">III", self.device_key, self.group_key, self.group_mask)
        if self.time is not None:
            payload += struct.pack(">Q", self.time)
        return Command(Code.ACTION, request_id, payload, flags)

    @classmethod
    def parse(cls, command: Command) -> "Action":
        """Parse the command. CameraProtocol if its payload is invalid."""
        scheduled = bool(command.flags & SCHEDULED)
        if len(command.payload) != (20 if scheduled else 12):
            raise CameraProtocol(f"an ACTION of {len(command.payload)} bytes")
        time = int.from_bytes(command.payload[12:], "big") if scheduled else None
        device_key, group_key, group_mask = struct.unpack_from(">III", command.payload)
        return cls(device_key, group_key, group_mask, time)

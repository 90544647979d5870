"""GenCP control packets as USB3 Vision sends them over bulk: bytes in, records out, nothing else.

A packet is a header of 12 bytes (prefix "U3VC", flags or status, code, payload size, request id), little
endian, and the payload, which GenCP calls the specific command data. Codes as in Aravis.
"""

import struct
from dataclasses import dataclass
from enum import IntEnum

from drivers.errors import CameraProtocol

PREFIX = 0x43563355
ACKNOWLEDGE = 0x4000
"""The flag of a command that wants an answer; all of ours do."""
_HEADER = struct.Struct("<IHHHH")
HEADER_SIZE = _HEADER.size
WRITE_OVERHEAD = HEADER_SIZE + 8
"""Bytes of a WriteMem command that are not data: the header and the address."""


class Code(IntEnum):
    """Packet type."""

    READ = 0x0800
    READ_ACK = 0x0801
    WRITE = 0x0802
    WRITE_ACK = 0x0803
    PENDING_ACK = 0x0805


class Status(IntEnum):
    """Status of a command."""

    SUCCESS = 0x0000
    NOT_IMPLEMENTED = 0x8001
    BAD_PARAMETER = 0x8002
    BAD_ADDRESS = 0x8003
    WRITE_PROTECTED = 0x8004
    MISALIGNED = 0x8005
    ACCESS_DENIED = 0x8006
    BUSY = 0x8007
    TIMEOUT = 0x800B
    BAD_HEADER = 0x800E
    WRONG_CONFIGURATION = 0x800F
    STREAM_HALTED = 0xA002
    TRANSFERS_UNSUITED = 0xA003
    TRANSFERS_INCONSISTENT = 0xA004


@dataclass(frozen=True)
class Packet:
    """A command or its answer. word: the flags of a command, the status of an answer."""

    word: int
    code: int
    request_id: int
    payload: bytes = b""

    def pack(self) -> bytes:
        """The bytes of the packet."""
        return _HEADER.pack(PREFIX, self.word, self.code, len(self.payload), self.request_id) + self.payload

    @classmethod
    def parse(cls, data: bytes) -> "Packet":
        """The packet in the first bytes of `data`. CameraProtocol if there is no whole one."""
        if len(data) < HEADER_SIZE:
            raise CameraProtocol(f"a control packet of {len(data)} bytes has no header: reset the camera.")
        prefix, word, code, size, request_id = _HEADER.unpack_from(data)
        if prefix != PREFIX:
            raise CameraProtocol(f"a control packet begins with {prefix:#010x}: reset the camera.")
        if len(data) - HEADER_SIZE != size:
            raise CameraProtocol(
                f"a control packet announces {size} bytes and has {len(data) - HEADER_SIZE}: "
                "reset the camera."
            )
        return cls(word, code, request_id, bytes(data[HEADER_SIZE:]))


def read_payload(address: int, size: int) -> bytes:
    """Return what a READ asks: `size` bytes from `address`."""
    return struct.pack("<QHH", address, 0, size)


def parse_read_payload(payload: bytes) -> tuple[int, int]:
    """Address and size of a READ."""
    if len(payload) != 12:
        raise CameraProtocol(f"a read command of {len(payload)} bytes should have 12: reset the camera.")
    address, _, size = struct.unpack("<QHH", payload)
    return address, size


def write_payload(address: int, data: bytes) -> bytes:
    """Return what a WRITE carries."""
    return struct.pack("<Q", address) + data


def parse_write_payload(payload: bytes) -> tuple[int, bytes]:
    """Address and data of a WRITE."""
    if len(payload) < 9:
        raise CameraProtocol(f"a write command of {len(payload)} bytes carries no data: reset the camera.")
    return int.from_bytes(payload[:8], "little"), payload[8:]


def number_payload(number: int) -> bytes:
    """Return what a WRITE_ACK (bytes written) and a PENDING_ACK (milliseconds to wait) carry."""
    return struct.pack("<HH", 0, number)


def parse_number_payload(payload: bytes) -> int:
    """The number of a WRITE_ACK or a PENDING_ACK."""
    if len(payload) != 4:
        raise CameraProtocol(f"an answer of {len(payload)} bytes should have 4: reset the camera.")
    return int.from_bytes(payload[2:], "little")

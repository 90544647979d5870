"""GVSP, the stream protocol of GigE Vision: datagrams in, packets of frames out, nothing else.

A frame is a leader, packets of payload and a trailer, numbered from 0. Its number has 16 bits and that of a
packet 24, or 64 and 32 where the device uses extended ids. All numbers are big endian. As in Aravis.
"""

import struct
from dataclasses import dataclass
from enum import IntEnum

from drivers.errors import CameraProtocol
from drivers.genicam.chunks import CHUNKS
from drivers.genicam.session import FrameLeader

IMAGE, CHUNKS_ALONE, EXTENDED_CHUNKS = 0x0001, 0x0004, 0x0005
"""Payload types: an image; an image among chunks, as version 1 of the standard has it, and later ones."""
_SHORT, _LONG = struct.Struct(">HHI"), struct.Struct(">HHIQI")
_LEADER, _IMAGE = struct.Struct(">HHQ"), struct.Struct(">IIIIIHH")
_TRAILER = struct.Struct(">HHI")
_EXTENDED = 0x80000000
_UDP = 28
"""Bytes of the headers of IP and UDP, which count as part of a packet."""


class Kind(IntEnum):
    """Content type of a packet."""

    LEADER = 1
    TRAILER = 2
    PAYLOAD = 3


def header_size(extended: bool) -> int:
    """Bytes before what a packet carries."""
    return _LONG.size if extended else _SHORT.size


def room(packet_size: int, extended: bool) -> int:
    """Bytes of payload in a packet of that size, as the register of the device counts."""
    return packet_size - _UDP - header_size(extended)


def datagram_size(packet_size: int) -> int:
    """Bytes of the datagram in a packet of that size."""
    return packet_size - _UDP


@dataclass(frozen=True)
class PacketHeader:
    """The head of a packet. number: of the packet in its frame; block: of the frame."""

    status: int
    block: int
    kind: int
    number: int
    extended: bool = False

    def pack(self) -> bytes:
        """The bytes before what it carries."""
        if self.extended:
            return _LONG.pack(self.status, 0, _EXTENDED | self.kind << 24, self.block, self.number)
        return _SHORT.pack(self.status, self.block & 0xFFFF, self.kind << 24 | self.number & 0xFFFFFF)

    @classmethod
    def parse(cls, data: bytes | memoryview) -> "PacketHeader":
        """The head of a datagram. CameraProtocol if it is too short for one."""
        if len(data) < _SHORT.size:
            raise CameraProtocol(f"a packet of {len(data)} bytes has no header")
        status, block, word = _SHORT.unpack_from(data)
        kind = word >> 24 & 0x7F
        if not word & _EXTENDED:
            return cls(status, block, kind, word & 0xFFFFFF)
        if len(data) < _LONG.size:
            raise CameraProtocol(f"a packet of {len(data)} bytes has no extended header")
        _, _, _, block, number = _LONG.unpack_from(data)
        return cls(status, block, kind, number, True)


class Leader(FrameLeader):
    """Header of a frame, whose timestamp is in ticks.

    An image among chunks of version 1 has neither format nor size here: they are 0.
    """

    def pack(self) -> bytes:
        """Return what a packet carries of it."""
        if self.payload_type == CHUNKS_ALONE:
            return _LEADER.pack(0, self.payload_type, self.timestamp)
        image = (self.pixel_format, self.width, self.height, self.left, self.top, self.padding, 0)
        return _LEADER.pack(0, self.payload_type, self.timestamp) + _IMAGE.pack(*image)

    @classmethod
    def parse(cls, block: int, data: bytes) -> "Leader":
        """Parse the content of a packet. CameraProtocol if it is too short."""
        if len(data) < _LEADER.size:
            raise CameraProtocol(f"a leader of {len(data)} bytes")
        _, kind, timestamp = _LEADER.unpack_from(data)
        if kind == CHUNKS_ALONE:
            return cls(block, IMAGE | CHUNKS, timestamp)
        if kind == EXTENDED_CHUNKS:
            kind = IMAGE | CHUNKS
        if kind & ~CHUNKS != IMAGE:
            return cls(block, kind, timestamp)
        if len(data) < _LEADER.size + _IMAGE.size:
            raise CameraProtocol(f"a leader of an image of {len(data)} bytes")
        *image, _ = _IMAGE.unpack_from(data, _LEADER.size)
        return cls(block, kind, timestamp, *image)


def rows(data: bytes) -> int:
    """Return how many rows of an image came, as its trailer says; 0 where it does not."""
    if len(data) < _TRAILER.size:
        return 0
    _, kind, height = _TRAILER.unpack_from(data)
    return int(height) if kind & ~CHUNKS == IMAGE else 0


def trailer(payload_type: int, height: int, payload: int) -> bytes:
    """Content of the last packet of a frame of that many bytes; more where chunks come with the image."""
    if payload_type in (CHUNKS_ALONE, EXTENDED_CHUNKS):
        long = payload_type == EXTENDED_CHUNKS
        return _TRAILER.pack(0, payload_type, payload) + (struct.pack(">II", height, 0) if long else b"")
    chunks = struct.pack(">II", payload, 0) if payload_type & CHUNKS else b""
    return _TRAILER.pack(0, payload_type, height) + chunks

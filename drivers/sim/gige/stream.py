"""Frames of the simulated GigE Vision camera as packets, some of which get lost; the last ones are kept."""

import socket
from collections import OrderedDict
from collections.abc import Container
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np

from drivers.genicam.chunks import CHUNKS
from drivers.gige import gvsp
from drivers.gige.gvcp import Resend, Status
from drivers.gige.gvsp import Kind, Leader, PacketHeader
from drivers.sim.genicam.frames import SentImage
from drivers.sim.genicam.quirks import Quirk

_BUFFERED = 32
"""Frames whose packets can be sent again."""


@dataclass
class Sender:
    """Sends from a socket of its own. loss: the share of packets that never leave; lost: how many did not."""

    socket: socket.socket
    chance: np.random.Generator
    extended: bool = False
    quirks: Container[Quirk] = ()
    loss: float = 0.0
    lost: int = 0
    sent: int = 0
    _resendable: OrderedDict[int, list[bytes]] = field(default_factory=OrderedDict)

    def frame(
        self, image: SentImage, block: int, stamp: int, packet_size: int, destination: tuple[str, int]
    ) -> None:
        """Send a frame, stamped with the device's clock."""
        kind = gvsp.IMAGE | (CHUNKS if image.chunked else 0)
        if image.chunked and Quirk.CHUNK_PAYLOAD in self.quirks:
            kind = gvsp.CHUNKS_ALONE
        elif image.chunked and Quirk.EXTENDED_CHUNK_PAYLOAD in self.quirks:
            kind = gvsp.EXTENDED_CHUNKS
        if Quirk.NO_STAMP in self.quirks:
            stamp = 0
        leader = Leader(block, kind, stamp, image.code, image.width, image.height, image.left, image.top)
        room, payload, height = gvsp.room(packet_size, self.extended), image.payload, image.height
        if Quirk.FEWER_ROWS in self.quirks:
            payload, height = payload[: len(payload) // 2], height // 2
        parts = [payload[start : start + room] for start in range(0, len(payload), room)]
        if parts and Quirk.PADDED in self.quirks:
            parts[-1] = parts[-1].ljust(room, b"\0")
        carried = [
            (Kind.LEADER, leader.pack()),
            *((Kind.PAYLOAD, part) for part in parts),
            (Kind.TRAILER, gvsp.trailer(kind, height, len(payload))),
        ]
        packets = [
            PacketHeader(0, block, which, number, self.extended).pack() + data
            for number, (which, data) in enumerate(carried)
        ]
        self._resendable[block] = packets
        while len(self._resendable) > _BUFFERED:
            self._resendable.popitem(last=False)
        for packet in self._sent_at_first(packets):
            for _ in range(2 if Quirk.DOUBLED in self.quirks else 1):
                self._send(packet, destination)

    def again(self, wanted: Resend, destination: tuple[str, int]) -> None:
        """Send packets once more, or say that they are gone."""
        packets = self._resendable.get(wanted.block)
        if packets is None:
            head = PacketHeader(Status.UNAVAILABLE, wanted.block, Kind.PAYLOAD, wanted.first, self.extended)
            self._send(head.pack(), destination)
            return
        size = gvsp.header_size(self.extended)
        if Quirk.NO_TRAILER_AGAIN in self.quirks and wanted.last >= len(packets) - 1:
            head = PacketHeader(Status.UNAVAILABLE, wanted.block, Kind.PAYLOAD, wanted.last, self.extended)
            self._send(head.pack(), destination)
            packets = packets[:-1]
        for packet in packets[wanted.first : wanted.last + 1]:
            if Quirk.MISNUMBERED in self.quirks and wanted.first > 1:
                self._send(packets[wanted.first - 1][:size] + packet[size:], destination)
            self._send(Status.RESENT.to_bytes(2, "big") + packet[2:], destination)

    def _sent_at_first(self, packets: list[bytes]) -> list[bytes]:
        """Return what is sent of a frame before anything is asked for again."""
        if Quirk.REVERSED in self.quirks:
            return packets[::-1]
        if Quirk.NO_TRAILER_AGAIN in self.quirks:
            return packets[:-1]
        if Quirk.MISNUMBERED in self.quirks:
            size = gvsp.header_size(self.extended)
            # Every fifth packet comes under the number of the one before, and its own is missing.
            return [
                packets[at - 1][:size] + packet[size:] if at % 5 == 3 else packet
                for at, packet in enumerate(packets)
            ]
        return packets

    def test(self, packet_size: int, destination: tuple[str, int]) -> None:
        """A packet of that size, to find out whether it arrives."""
        if Quirk.NO_TEST_PACKET in self.quirks:
            return
        data = PacketHeader(0, 0, Kind.PAYLOAD, 0).pack().ljust(gvsp.datagram_size(packet_size), b"\0")
        self._send(data, destination)

    def forget(self) -> None:
        """Clear the buffer: nothing can be sent again."""
        self._resendable.clear()

    def _send(self, packet: bytes, destination: tuple[str, int]) -> None:
        self.sent += 1
        if self.chance.random() < self.loss:
            self.lost += 1
            return
        with suppress(OSError):  # no receiver, or the packet is too large for the way
            self.socket.sendto(packet, destination)

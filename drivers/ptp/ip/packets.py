"""The packets of PTP/IP, and a TCP connection that carries them.

CIPA DC-005: u32 length, u32 type, fields, all little-endian; the length counts its own 8 bytes.
"""

import select
import socket
import struct
import threading
import time
from contextlib import suppress
from enum import IntEnum

from drivers.errors import CameraLost, CameraNotFound, CameraTimeout
from drivers.ptp.protocol.codec import damaged

PORT = 15740
"""Port of cameras."""
HEAD = 8
"""Bytes of a packet before its fields."""
VERSION = 0x00010000
"""Protocol version 1.0."""
_CONNECT_TIMEOUT = 5.0
_SEND_TIMEOUT = 20.0


class PacketType(IntEnum):
    """Packet types."""

    INIT_COMMAND_REQUEST = 1
    INIT_COMMAND_ACK = 2
    INIT_EVENT_REQUEST = 3
    INIT_EVENT_ACK = 4
    INIT_FAIL = 5
    OPERATION_REQUEST = 6
    RESPONSE = 7
    EVENT = 8
    START_DATA = 9
    DATA = 10
    CANCEL = 11
    END_DATA = 12
    PING = 13
    PONG = 14


def place_of(host: str, port: int) -> str:
    """Name of the place for messages: `PTP/IP 192.168.1.20`, with the port where it is not the usual one."""
    return f"PTP/IP {host}" + ("" if port == PORT else f":{port}")


class Link:
    """One connection to a camera. A packet that a time-out interrupts is read on the next time."""

    def __init__(self, host: str, port: int) -> None:
        """Connect. CameraNotFound if nothing listens there, or the host is unreachable."""
        self.where = place_of(host, port)
        try:
            self._socket = socket.create_connection((host, port), _CONNECT_TIMEOUT)
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise CameraNotFound(
                f"{self.where} cannot be reached ({reason}): switch the camera's Wi-Fi and its remote "
                "control on, and correct the address."
            ) from error
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        # A time-out of the socket's own would be that of all threads.
        self._socket.setblocking(False)
        self._sending = threading.Lock()
        self._packet, self._filled = bytearray(HEAD), 0
        self.in_step = True
        """True if the next byte begins a packet, or continues one of known type."""

    def send(self, kind: PacketType, fields: bytes) -> None:
        """One packet, from any thread. CameraLost; CameraTimeout, after which it is out of step."""
        unsent = memoryview(struct.pack("<II", HEAD + len(fields), kind) + fields)
        end = time.monotonic() + _SEND_TIMEOUT
        with self._sending:
            while unsent:
                try:
                    _, able, _ = select.select([], [self._socket], [], max(0.0, end - time.monotonic()))
                    sent = self._socket.send(unsent) if able else 0
                except BlockingIOError:
                    continue
                except (OSError, ValueError) as error:  # ValueError: it was closed here
                    raise self._lost() from error
                if not able:
                    self.in_step = False
                    raise CameraTimeout(f"{self.where} takes no more bytes: wake the camera up.")
                unsent = unsent[sent:]

    def receive(self, timeout: float | None, most: int) -> tuple[int, bytes]:
        """Type and fields of the next packet of at most `most` bytes.

        timeout: seconds for each piece of it, None for ever. CameraTimeout, CameraLost; CameraProtocol for
        bytes that are no packet, after which no others are known to be one.
        """
        self._fill(HEAD, timeout)
        length, kind = struct.unpack_from("<II", self._packet)
        if not HEAD <= length <= most:
            self.in_step = False
            raise damaged(f"a packet of {length} bytes")
        if len(self._packet) < length:
            self._packet += bytes(length - len(self._packet))
        self._fill(length, timeout)
        fields = bytes(memoryview(self._packet)[HEAD:length])
        self._packet, self._filled = bytearray(HEAD), 0
        return kind, fields

    def hang_up(self) -> None:
        """End the connection, which wakes a thread that waits for a packet; `close` it once that is gone."""
        with suppress(OSError):  # it has ended by itself
            self._socket.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """Hang up and let go; a second time does nothing."""
        self.hang_up()
        self._socket.close()

    def _fill(self, size: int, timeout: float | None) -> None:
        """Read until the first `size` bytes of the packet are buffered."""
        with memoryview(self._packet) as view:
            while self._filled < size:
                try:
                    ready, _, _ = select.select([self._socket], [], [], timeout)
                    count = self._socket.recv_into(view[self._filled : size]) if ready else 0
                except BlockingIOError:
                    continue
                except (OSError, ValueError) as error:
                    raise self._lost() from error
                if not ready:
                    raise CameraTimeout(
                        f"{self.where} does not answer: wake the camera up, or bring it nearer."
                    )
                if not count:
                    raise self._lost()
                self._filled += count

    def _lost(self) -> CameraLost:
        return CameraLost(f"{self.where} hung up: wake the camera up, and connect its Wi-Fi again.")

"""A PTP/IP server in front of a responder, so that other people's programs can shoot with a simulated camera.

CIPA DC-005: two connections a client, one for operations and one for events; every packet is
u32 length, u32 type, fields, all little-endian. The port is on loopback unless told otherwise.
"""

import socket
import struct
import threading
from contextlib import suppress
from enum import IntEnum
from typing import Self

from drivers.ptp.codec import Event
from drivers.sim.ptp_operations import Request
from drivers.sim.ptp_responder import Responder

PORT = 15740
"""Where clients look if they are not told otherwise."""
_VERSION = 0x00010000
_MOST = 1 << 20
"""Bytes of the largest packet that is taken, and of the data packets that are sent."""
_DATA_TO_CAMERA = 2


class _Type(IntEnum):
    INIT_COMMAND_REQUEST = 1
    INIT_COMMAND_ACK = 2
    INIT_EVENT_REQUEST = 3
    INIT_EVENT_ACK = 4
    OPERATION_REQUEST = 6
    RESPONSE = 7
    EVENT = 8
    START_DATA = 9
    DATA = 10
    END_DATA = 12
    PING = 13
    PONG = 14


class _Refused(Exception):
    """What came is no PTP/IP; the connection is closed."""


class _Connection:
    """Packets on a socket."""

    def __init__(self, link: socket.socket) -> None:
        self._link = link
        self._sending = threading.Lock()

    def send(self, kind: _Type, payload: bytes) -> None:
        with self._sending:
            self._link.sendall(struct.pack("<II", 8 + len(payload), kind) + payload)

    def receive(self) -> tuple[int, bytes]:
        """Type and payload. _Refused for the end of the connection too."""
        length, kind = struct.unpack("<II", self._exactly(8))
        if not 8 <= length <= _MOST:
            raise _Refused
        return kind, self._exactly(length - 8)

    def expect(self, kind: _Type, least: int) -> bytes:
        """The payload of a packet that has to be of a type and of at least that many bytes."""
        came, payload = self.receive()
        if came != kind or len(payload) < least:
            raise _Refused
        return payload

    def _exactly(self, size: int) -> bytes:
        data = b""
        while len(data) < size:
            part = self._link.recv(size - len(data))
            if not part:
                raise _Refused
            data += part
        return data


class PtpIpServer:
    """Serves one camera until it is closed; one client at a time, the newest."""

    def __init__(self, responder: Responder, host: str = "127.0.0.1", port: int = PORT) -> None:
        """OSError if the address cannot be had; port 0 takes a free one."""
        self._responder = responder
        self._listening = socket.create_server((host, port))
        self.host, self.port = self._listening.getsockname()[:2]
        self._links: set[socket.socket] = set()
        self._threads: list[threading.Thread] = []
        self._lock = threading.Lock()
        self._session = 0
        self._accepting = threading.Thread(target=self._accept, name="ptpip", daemon=True)
        self._accepting.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Hang up on everybody."""
        with self._lock:
            links, self._links = self._links, set()
        # shutdown, not close alone: it wakes the threads that wait on the sockets.
        for link in (self._listening, *links):
            _hang_up(link)
        for thread in (self._accepting, *self._threads):
            thread.join()

    def _accept(self) -> None:
        while True:
            try:
                link, _ = self._listening.accept()
            except OSError:
                return
            link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            with self._lock:
                self._links.add(link)
                self._threads = [thread for thread in self._threads if thread.is_alive()]
                thread = threading.Thread(target=self._serve, args=(link,), name="ptpip client", daemon=True)
                self._threads.append(thread)
            thread.start()

    def _serve(self, link: socket.socket) -> None:
        connection = _Connection(link)
        try:
            kind, payload = connection.receive()
            if kind == _Type.INIT_COMMAND_REQUEST:
                self._commands(connection)
            elif kind == _Type.INIT_EVENT_REQUEST:
                self._events(connection, payload)
        except (_Refused, OSError):
            pass  # The client went away or speaks something else: there is nobody to tell.
        finally:
            with self._lock:
                self._links.discard(link)
            _hang_up(link)

    def _commands(self, connection: _Connection) -> None:
        with self._responder.timeline.lock:
            # A new client takes over: events of its session must not go to the one before.
            self._session += 1
            session = self._session
            self._responder.reset()
            self._responder.listener = None
        name = f"{self._responder.profile.model}\0".encode("utf-16-le")
        ack = struct.pack("<I", session) + bytes(16) + name + struct.pack("<I", _VERSION)
        connection.send(_Type.INIT_COMMAND_ACK, ack)
        while True:
            payload = connection.expect(_Type.OPERATION_REQUEST, 10)
            phase, operation, transaction = struct.unpack_from("<IHI", payload)
            count = min(5, (len(payload) - 10) // 4)
            parameters = struct.unpack_from(f"<{count}I", payload, 10)
            data = self._data_from(connection) if phase == _DATA_TO_CAMERA else b""
            reply = self._responder.handle(Request(operation, transaction, parameters, data))
            if reply.data is not None:
                self._data_to(connection, transaction, reply.data)
            fields = struct.pack(f"<HI{len(reply.parameters)}I", reply.code, transaction, *reply.parameters)
            connection.send(_Type.RESPONSE, fields)

    def _data_from(self, connection: _Connection) -> bytes:
        connection.expect(_Type.START_DATA, 12)
        data = b""
        while True:
            kind, payload = connection.receive()
            if kind not in (_Type.DATA, _Type.END_DATA) or len(payload) < 4 or len(data) > _MOST:
                raise _Refused
            data += payload[4:]
            if kind == _Type.END_DATA:
                return data

    def _data_to(self, connection: _Connection, transaction: int, data: bytes) -> None:
        head = struct.pack("<I", transaction)
        connection.send(_Type.START_DATA, head + struct.pack("<Q", len(data)))
        last = max(0, len(data) - 1) // _MOST * _MOST
        for at in range(0, last, _MOST):
            connection.send(_Type.DATA, head + data[at : at + _MOST])
        connection.send(_Type.END_DATA, head + data[last:])

    def _events(self, connection: _Connection, payload: bytes) -> None:
        def tell(event: Event) -> None:
            parameters = (*event.parameters, 0, 0, 0)[:3]
            fields = struct.pack("<HI3I", event.code, event.transaction, *parameters)
            with suppress(OSError):  # The client has gone; its commands end as well.
                connection.send(_Type.EVENT, fields)

        with self._responder.timeline.lock:
            if len(payload) < 4 or struct.unpack_from("<I", payload)[0] != self._session:
                raise _Refused
            self._responder.listener = tell
        connection.send(_Type.INIT_EVENT_ACK, b"")
        while True:
            kind, _ = connection.receive()
            if kind == _Type.PING:
                connection.send(_Type.PONG, b"")


def _hang_up(link: socket.socket) -> None:
    with suppress(OSError):  # It was not connected, or is no longer.
        link.shutdown(socket.SHUT_RDWR)
    link.close()

"""A PTP/IP server in front of a responder, so that other people's programs can shoot with a simulated camera.

CIPA DC-005: two connections a client, one for operations and one for events; every packet is
u32 length, u32 type, fields, all little-endian.
"""

import socket
import struct
import threading
from contextlib import suppress
from dataclasses import replace

from drivers.ptp.ip.packets import PORT, VERSION, PacketType
from drivers.ptp.protocol.codec import Event
from drivers.ptp.protocol.codes import ResponseCode
from drivers.sim.faults import Kind
from drivers.sim.ptp.operations import Reply, Request
from drivers.sim.ptp.responder import Responder
from drivers.sim.serving import Refused, TcpServer, exactly

_MOST = 1 << 20
"""Bytes of the largest packet that is taken, and of the data packets that are sent."""
_MOST_AT_FIRST, _PATIENCE = 1 << 10, 10.0
"""Bytes of the first packet of a connection, and seconds that it may take: the client is unidentified until
then.
"""
_BUSY = 2
"""Reason of an Init Fail, as bodies give it to a second client."""
_GRACE = 1.0
"""Seconds in which a client that has hung up is noticed."""
_DATA_TO_CAMERA = 2
_HEAD = 4
"""Bytes of the transaction in front of data."""


_CARRIER = frozenset({Kind.TIMEOUT, Kind.TRUNCATED, Kind.WRONG_TRANSACTION, Kind.UNPLUG})
"""Faults of the connection; unplugged is a connection that breaks."""


class _Connection:
    """Packets on a socket."""

    def __init__(self, link: socket.socket) -> None:
        self._link = link
        self._sending = threading.Lock()

    def send(self, kind: PacketType, payload: bytes) -> None:
        with self._sending:
            self._link.sendall(struct.pack("<II", 8 + len(payload), kind) + payload)

    def receive(self, most: int = _MOST) -> tuple[int, bytes]:
        """Type and payload of a packet of at most that many bytes. Refused, also at its end."""
        length, kind = struct.unpack("<II", exactly(self._link, 8))
        if not 8 <= length <= most:
            raise Refused
        return kind, exactly(self._link, length - 8)


def listen(host: str = "127.0.0.1", port: int = PORT) -> socket.socket:
    """Open the socket of a server, by default on loopback; port 0 takes a free one. OSError."""
    return socket.create_server((host, port))


class PtpIpServer(TcpServer):
    """Serves one camera until it is closed, to one client at a time.

    Others are refused while it has both connections; of one that has not, a new client takes the place.
    """

    def __init__(self, responder: Responder, listening: socket.socket) -> None:
        """listening: of `listen`; it is closed with the server."""
        self._responder = responder
        self._served: set[socket.socket] = set()
        """Connections of the client whose session it is."""
        self._lock = threading.Condition()
        self._session = 0
        self._cancelled = threading.Event()
        """Set when the client gives up the operation that gets no answer."""
        super().__init__(listening, "ptpip")

    def _serve(self, link: socket.socket) -> None:
        connection = _Connection(link)
        try:
            link.settimeout(_PATIENCE)
            kind, payload = connection.receive(_MOST_AT_FIRST)
            link.settimeout(None)
            if kind == PacketType.INIT_COMMAND_REQUEST:
                self._commands(connection, link)
            elif kind == PacketType.INIT_EVENT_REQUEST:
                self._events(connection, link, payload)
        finally:
            with self._lock:
                self._served.discard(link)
                self._lock.notify_all()

    def _commands(self, connection: _Connection, link: socket.socket) -> None:
        with self._lock:
            free = self._lock.wait_for(lambda: len(self._served) < 2, _GRACE)
        if not free:
            connection.send(PacketType.INIT_FAIL, struct.pack("<I", _BUSY))
            return
        with self._responder.timeline.lock:
            # A client that was half there must neither go on in its session nor hear the events of this one.
            self._session += 1
            session = self._session
            self._responder.reset()
            self._responder.listener = None
            with self._lock:
                before, self._served = self._served, {link}
        for waiting in before:
            with suppress(OSError):  # it has gone by itself
                waiting.shutdown(socket.SHUT_RDWR)
        name = f"{self._responder.profile.model}\0".encode("utf-16-le")
        ack = struct.pack("<I", session) + bytes(16) + name + struct.pack("<I", VERSION)
        connection.send(PacketType.INIT_COMMAND_ACK, ack)
        try:
            self._serve_commands(connection, session)
        finally:
            with self._lock:
                rest = self._served - {link} if session == self._session else set()
            for waiting in rest:
                with suppress(OSError):
                    waiting.shutdown(socket.SHUT_RDWR)

    def _serve_commands(self, connection: _Connection, session: int) -> None:
        while True:
            kind, payload = connection.receive()
            if kind == PacketType.END_DATA and len(payload) <= _HEAD:
                continue  # of data that had no bytes, and was complete without it
            if kind != PacketType.OPERATION_REQUEST or len(payload) < 10:
                raise Refused
            phase, operation, transaction = struct.unpack_from("<IHI", payload)
            count = min(5, (len(payload) - 10) // 4)
            parameters = struct.unpack_from(f"<{count}I", payload, 10)
            data = self._data_from(connection) if phase == _DATA_TO_CAMERA else b""
            self._run(connection, session, Request(operation, transaction, parameters, data))

    def _run(self, connection: _Connection, session: int, request: Request) -> None:
        """Run an operation and answer, as far as its faults allow."""
        with self._responder.timeline.lock:
            if session != self._session:
                raise Refused
            fault_of = {fault.kind: fault for fault in self._responder.faults(request, _CARRIER)}
            if Kind.TIMEOUT in fault_of:
                self._cancelled.clear()
                reply = Reply(ResponseCode.TRANSACTION_CANCELLED)
            else:
                reply = self._responder.handle(replace(request, faults=tuple(fault_of.values())))
        if Kind.UNPLUG in fault_of:
            raise Refused
        if Kind.TIMEOUT in fault_of:
            self._cancelled.wait(_PATIENCE)
        transaction = request.transaction + (Kind.WRONG_TRANSACTION in fault_of)
        if reply.data is not None:
            cut = fault_of.get(Kind.TRUNCATED)
            self._data_to(connection, transaction, reply.data, None if cut is None else cut.count)
        fields = struct.pack(f"<HI{len(reply.parameters)}I", reply.code, transaction, *reply.parameters)
        connection.send(PacketType.RESPONSE, fields)

    def _data_from(self, connection: _Connection) -> bytes:
        kind, payload = connection.receive()
        if kind != PacketType.START_DATA or len(payload) < _HEAD + 8:
            raise Refused
        if not any(payload[_HEAD : _HEAD + 8]):
            return b""  # libgphoto2 ends data of length 0 here, others with an EndData
        data = bytearray()
        while True:
            kind, payload = connection.receive()
            if (
                kind not in (PacketType.DATA, PacketType.END_DATA)
                or len(payload) < _HEAD
                or len(data) > _MOST
            ):
                raise Refused
            data += payload[_HEAD:]
            if kind == PacketType.END_DATA:
                return bytes(data)

    def _data_to(self, connection: _Connection, transaction: int, data: bytes, cut: int | None) -> None:
        head = struct.pack("<I", transaction)
        connection.send(PacketType.START_DATA, head + struct.pack("<Q", len(data)))
        data = data[:cut]
        last = max(0, len(data) - 1) // _MOST * _MOST
        for at in range(0, last, _MOST):
            connection.send(PacketType.DATA, head + data[at : at + _MOST])
        connection.send(PacketType.END_DATA, head + data[last:])

    def _events(self, connection: _Connection, link: socket.socket, payload: bytes) -> None:
        def tell(event: Event) -> None:
            parameters = (*event.parameters, 0, 0, 0)[:3]
            fields = struct.pack("<HI3I", event.code, event.transaction, *parameters)
            with suppress(OSError):  # The client has gone; its commands end as well.
                connection.send(PacketType.EVENT, fields)

        with self._responder.timeline.lock:
            if len(payload) < 4 or struct.unpack_from("<I", payload)[0] != self._session:
                raise Refused
            self._responder.listener = tell
            with self._lock:
                self._served.add(link)
        connection.send(PacketType.INIT_EVENT_ACK, b"")
        while True:
            kind, _ = connection.receive()
            if kind == PacketType.PING:
                connection.send(PacketType.PONG, b"")
            elif kind == PacketType.CANCEL:
                self._cancelled.set()

"""PTP transactions over the two connections of PTP/IP, and the way back after one has failed."""

import struct
import threading
from collections import deque
from contextlib import suppress

from drivers.clock import Clock
from drivers.errors import CameraLost, CameraProtocol, CameraTimeout
from drivers.ptp.ip.packets import HEAD, Link, PacketType
from drivers.ptp.protocol.codec import Command, Event, Response, damaged
from drivers.ptp.protocol.transaction import MOST_BYTES, TIMEOUT, Answer, ResponseLost
from imaging.errors import CameraError

_NO_DATA_OUT, _DATA_OUT = 1, 2
"""Data phase codes of an operation request: no data from the host, or some."""
_TRANSACTION = 4
"""Bytes of the transaction's number in front of data."""
_UNKNOWN = 0xFFFFFFFFFFFFFFFF
"""A length of data that is not known beforehand."""
_SMALL = 1 << 10
"""Bytes of the longest packet that holds no data."""
_PIECE = 1 << 16
"""Bytes of a data packet to the camera."""
_CANCEL_TIMEOUT = 2.0
_MOST_PACKETS = 4096
_MOST_EVENTS = 1 << 11


class IpTransport:
    """Runs transactions on a command connection; a thread hears the event connection and answers pings.

    A camera whose connection broke, or fell out of step, is lost: it has to be connected to anew.
    """

    def __init__(self, commands: Link, events: Link, clock: Clock) -> None:
        self.where = commands.where
        self._commands, self._event_link, self._clock = commands, events, clock
        self._events: deque[Event] = deque(maxlen=_MOST_EVENTS)
        self._deaf = False
        self._listener = threading.Thread(target=self._listen, name=f"events of {self.where}", daemon=True)
        self._listener.start()

    def transact(
        self, command: Command, data: bytes | None = None, *, timeout: float = TIMEOUT, most: int = MOST_BYTES
    ) -> Answer:
        """One transaction, whatever the response code. `timeout` is for each piece, in seconds.

        CameraProtocol, CameraTimeout, CameraLost; after the first two it needs `recover`.
        """
        with self._clock.lock:
            if self._deaf:
                raise CameraLost(f"{self.where} hung up: wake the camera up, and connect its Wi-Fi again.")
        head = struct.pack(
            "<IHI", _NO_DATA_OUT if data is None else _DATA_OUT, command.code, command.transaction
        )
        parameters = struct.pack(f"<{len(command.parameters)}I", *command.parameters)
        self._commands.send(PacketType.OPERATION_REQUEST, head + parameters)
        if data is not None:
            self._send_data(command.transaction, data)
        kind, fields = self._commands.receive(timeout, most + _SMALL)
        payload = None
        if kind == PacketType.START_DATA:
            payload = self._receive_data(command.transaction, fields, timeout, most)
            try:
                kind, fields = self._commands.receive(timeout, _SMALL)
            except CameraTimeout as error:
                raise ResponseLost(error, payload) from error
        if kind != PacketType.RESPONSE:
            raise damaged(f"a packet of type {kind} where a response was due")
        return Answer(_response(fields, command.transaction), payload)

    def recover(self, error: CameraError, transaction: int) -> bool:
        """Cancel what was under way, and throw its answer away; CameraLost if none comes."""
        with suppress(CameraError):
            if self._commands.in_step:
                self._event_link.send(PacketType.CANCEL, struct.pack("<I", transaction))
                for _ in range(_MOST_PACKETS):
                    kind, _ = self._commands.receive(_CANCEL_TIMEOUT, MOST_BYTES + _SMALL)
                    if kind == PacketType.RESPONSE:
                        return True
        self.close()
        raise CameraLost(
            f"{self.where} stays stuck: switch the camera's Wi-Fi, or the camera, off and on."
        ) from error

    def reset(self) -> None:
        """CameraProtocol: there is no such request; a new connection does the same."""
        raise CameraProtocol(f"{self.where} cannot be reset over the network: switch it off and on.")

    def events(self, timeout: float) -> list[Event]:
        """The events that have come, or the first to come within `timeout` seconds. CameraLost."""
        self._clock.wait(lambda: bool(self._events) or self._deaf, timeout)
        with self._clock.lock:
            events = list(self._events)
            self._events.clear()
            if self._deaf and not events:
                raise CameraLost(f"{self.where} hung up: wake the camera up, and connect its Wi-Fi again.")
        return events

    def close(self) -> None:
        """Hang up; a second time does nothing."""
        self._event_link.hang_up()
        self._listener.join()
        self._commands.close()
        self._event_link.close()

    def _send_data(self, transaction: int, data: bytes) -> None:
        head = struct.pack("<I", transaction)
        self._commands.send(PacketType.START_DATA, head + struct.pack("<Q", len(data)))
        last = max(0, len(data) - 1) // _PIECE * _PIECE
        for at in range(0, last, _PIECE):
            self._commands.send(PacketType.DATA, head + data[at : at + _PIECE])
        self._commands.send(PacketType.END_DATA, head + data[last:])

    def _receive_data(self, transaction: int, start: bytes, timeout: float, most: int) -> bytes:
        """The data that a start packet announces."""
        if len(start) != _TRANSACTION + 8:
            raise damaged(f"a start of data of {len(start)} bytes")
        number, length = struct.unpack("<IQ", start)
        _must_belong(number, transaction)
        if length > most and length != _UNKNOWN:
            raise damaged(f"{length} bytes where at most {most} were asked for")
        data = bytearray()
        while True:
            kind, fields = self._commands.receive(timeout, most + HEAD + _TRANSACTION)
            if kind not in (PacketType.DATA, PacketType.END_DATA) or len(fields) < _TRANSACTION:
                raise damaged(f"a packet of type {kind} and {len(fields)} bytes among data")
            _must_belong(int.from_bytes(fields[:_TRANSACTION], "little"), transaction)
            data += memoryview(fields)[_TRANSACTION:]
            if len(data) > most:
                raise damaged(f"more than the {most} bytes that were asked for")
            if kind == PacketType.END_DATA:
                break
        if length not in (len(data), _UNKNOWN):
            raise damaged(f"{len(data)} bytes of data of {length}")
        return bytes(data)

    def _listen(self) -> None:
        """Take events and answer pings, until the connection ends; what makes no sense is passed over."""
        try:
            while True:
                kind, fields = self._event_link.receive(None, _SMALL)
                if kind == PacketType.PING:
                    self._event_link.send(PacketType.PONG, b"")
                elif kind == PacketType.EVENT and 6 <= len(fields) <= 18 and len(fields) % 4 == 2:
                    code, number = struct.unpack_from("<HI", fields)
                    parameters = struct.unpack_from(f"<{(len(fields) - 6) // 4}I", fields, 6)
                    with self._clock.lock:
                        self._events.append(Event(code, number, parameters))
                        self._clock.changed()
        except (CameraProtocol, CameraTimeout, CameraLost):
            with self._clock.lock:
                self._deaf = True
                self._clock.changed()


def _response(fields: bytes, transaction: int) -> Response:
    if not 6 <= len(fields) <= 26 or len(fields) % 4 != 2:
        raise damaged(f"a response of {len(fields)} bytes")
    code, number = struct.unpack_from("<HI", fields)
    _must_belong(number, transaction)
    return Response(code, number, struct.unpack_from(f"<{(len(fields) - 6) // 4}I", fields, 6))


def _must_belong(number: int, transaction: int) -> None:
    if number != transaction:
        raise damaged(f"transaction {number} in answer to {transaction}")

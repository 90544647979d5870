"""PTP transactions over a claimed USB interface, and the ways back after one has failed.

After libgphoto2's usb.c. A command goes out, data go in one direction or in none,
a response comes in; one transaction at a time.
"""

from array import array
from collections.abc import Callable
from functools import partial

from drivers.clock import Clock
from drivers.errors import CameraLost, CameraProtocol, CameraTimeout
from drivers.ptp.protocol.codec import (
    HEADER_SIZE,
    Command,
    ContainerType,
    Data,
    Event,
    Header,
    Reader,
    Response,
    damaged,
)
from drivers.ptp.protocol.codes import UNKNOWN_LENGTH, EventCode, ResponseCode
from drivers.ptp.protocol.transaction import MOST_BYTES, TIMEOUT, Answer, ResponseLost
from drivers.usb import EndpointStalled, UsbPipe
from imaging.errors import CameraError

_CANCEL, _RESET, _STATUS = 0x64, 0x66, 0x67
_CLASS_OUT, _CLASS_IN = 0x21, 0xA1
_CONTROL_TIMEOUT, _DRAIN_TIMEOUT = 2.0, 0.05
_SETTLE_SECONDS = 5.0
_CHUNK = 1 << 18
"""Bytes of one read, a multiple of every wMaxPacketSize; 64 KiB to 1 MiB were the fastest."""
_MOST_READS = 512
_MOST_EVENTS = 64


class UsbTransport:
    """Runs transactions on a pipe; waits on `clock`, so that simulated time suffices."""

    def __init__(self, pipe: UsbPipe, clock: Clock) -> None:
        self.pipe, self._clock = pipe, clock
        self.where = pipe.where
        self._out = pipe.endpoint(into_host=False)
        self._in = pipe.endpoint(into_host=True)
        try:
            self._interrupt = pipe.endpoint(into_host=True, interrupt=True)
        except CameraProtocol:
            self._interrupt = None
        packet = self._in.wMaxPacketSize or 1
        self._chunk = array("B", bytes(-(-_CHUNK // packet) * packet))
        self._surplus = b""
        self._event_bytes = b""

    def transact(
        self, command: Command, data: bytes | None = None, *, timeout: float = TIMEOUT, most: int = MOST_BYTES
    ) -> Answer:
        """One transaction, whatever the response code. `timeout` is for each transfer, in seconds.

        Only a command that the camera halted before it took a byte is sent again. CameraProtocol,
        CameraTimeout, CameraLost; after the first two the pipe needs `recover`.
        """
        packed = command.pack()
        try:
            self._send(packed, timeout)
        except EndpointStalled:
            self._clear_halts()
            self._settled()
            self._send(packed, timeout)
        if data is not None:
            self._send(Data(command.code, command.transaction, data).pack(), timeout)
        container, payload = self._receive(timeout, most), None
        if Header.unpack(container).kind == ContainerType.DATA:
            answer = Data.unpack(container)
            self._must_belong(answer.transaction, command)
            payload = answer.payload
            try:
                container = self._receive(timeout, 64)
            except CameraTimeout as error:
                raise ResponseLost(error, payload) from error
        response = Response.unpack(container)
        self._must_belong(response.transaction, command)
        return Answer(response, payload)

    def recover(self, error: CameraError, transaction: int) -> bool:
        """Bring the pipe back in step after `error`; False if that cost the session, which is then to open.

        CameraLost if the camera had to be reset on the bus, or is gone.
        """
        self._surplus = b""
        if isinstance(error, EndpointStalled):
            self._clear_halts()
        else:
            self._ask(lambda: self._cancel(transaction))
        if self._drain() and self._settled():
            return True
        if self._ask(self.reset) and self._drain() and self._settled():
            return False
        self._ask(self.pipe.reset)
        raise CameraLost(f"{self.pipe.where} stays stuck: switch the camera off and on.") from error

    def reset(self) -> None:
        """Class request Device Reset: the camera drops its session and all it was doing."""
        self._surplus = self._event_bytes = b""
        self.pipe.control_out(_CLASS_OUT, _RESET, 0, b"", _CONTROL_TIMEOUT)
        self._clear_halts()

    def events(self, timeout: float) -> list[Event]:
        """Return pending events, or the first to come within `timeout` seconds; perhaps none.

        Bytes that are no event are dropped: events only hasten what polling also finds. CameraLost.
        """
        events: list[Event] = []
        if self._interrupt is None:
            self._clock.sleep(timeout)
            return events
        try:
            for _ in range(_MOST_EVENTS):
                event = self._event(0.001 if events else timeout)
                if event is not None:
                    events.append(event)
            if not events:
                self._clock.sleep(timeout)
        except CameraTimeout:
            pass
        except EndpointStalled:
            self._ask(lambda: self.pipe.clear_halt(self._interrupt))
            self._clock.sleep(timeout)
        except CameraProtocol:
            self._event_bytes = b""
            self._clock.sleep(timeout)
        return events

    def close(self) -> None:
        """Let go of the interface."""
        self.pipe.close()

    def _send(self, packed: bytes, timeout: float) -> None:
        """A container, and the zero-length packet that ends one of whole packets."""
        sent = self.pipe.write(self._out, packed, timeout)
        if sent != len(packed):
            raise CameraTimeout(f"{self.pipe.where} took {sent} of {len(packed)} bytes: reset the camera.")
        if len(packed) % (self._out.wMaxPacketSize or 1) == 0:
            self.pipe.write(self._out, b"", timeout)

    def _read(self, timeout: float) -> bytes:
        count = self.pipe.read_into(self._in, self._chunk, timeout)
        return memoryview(self._chunk)[:count].tobytes()

    def _receive(self, timeout: float, most: int) -> bytes:
        """One whole container; what was read beyond it is kept as the beginning of the next."""
        first, self._surplus = self._surplus, b""
        # A zero-length packet that ended the container before may still lie there.
        buffer = bytearray(first or self._read(timeout) or self._read(timeout))
        header = Header.unpack(bytes(buffer[:HEADER_SIZE]))
        if header.length == UNKNOWN_LENGTH:
            self._read_to_its_end(buffer, timeout, most)
            return bytes(buffer)
        if header.length > most + HEADER_SIZE:
            raise damaged(f"{header.length} bytes where at most {most} were asked for")
        last, packet = 0 if first else len(buffer), self._in.wMaxPacketSize or 1
        while len(buffer) < header.length:
            # A short packet ends a transfer; only the header may travel alone.
            piece = b"" if last % packet and len(buffer) != HEADER_SIZE else self._read(timeout)
            if not piece:
                raise damaged(f"{len(buffer)} bytes of a container of {header.length}")
            buffer += piece
            last = len(piece)
        surplus = bytes(buffer[header.length :])
        self._surplus = surplus if len(surplus) >= HEADER_SIZE else b""
        del buffer[header.length :]
        return bytes(buffer)

    def _read_to_its_end(self, buffer: bytearray, timeout: float, most: int) -> None:
        """The rest of a container of unknown length: up to a short packet, unless that is the header's."""
        last = len(buffer)
        while last == len(self._chunk) or len(buffer) == HEADER_SIZE:
            piece = self._read(timeout)
            if not piece:
                return
            buffer += piece
            last = len(piece)
            if len(buffer) > most + HEADER_SIZE:
                raise damaged(f"more than the {most} bytes that were asked for")

    def _must_belong(self, transaction: int, command: Command) -> None:
        if transaction != command.transaction:
            raise damaged(f"transaction {transaction} in answer to {command.transaction}")

    def _event(self, timeout: float) -> Event | None:
        """One event, put together from as many pieces as it comes in; None for an empty packet."""
        piece = self.pipe.read(self._interrupt, 24, timeout)
        self._event_bytes += piece
        if len(self._event_bytes) < HEADER_SIZE:
            return None
        length = Header.unpack(self._event_bytes).length
        if length > 24:
            raise damaged(f"an event of {length} bytes")
        if len(self._event_bytes) < length:
            return None
        packed, self._event_bytes = self._event_bytes[:length], self._event_bytes[length:]
        return Event.unpack(packed)

    def _cancel(self, transaction: int) -> None:
        request = EventCode.CANCEL_TRANSACTION.to_bytes(2, "little") + transaction.to_bytes(4, "little")
        self.pipe.control_out(_CLASS_OUT, _CANCEL, 0, request, _CONTROL_TIMEOUT)

    def _ask(self, request: Callable[[], None]) -> bool:
        """Return whether the camera did it; CameraLost if it is gone."""
        try:
            request()
        except CameraLost:
            raise
        except CameraError:
            return False
        return True

    def _status(self) -> tuple[int, tuple[int, ...]] | None:
        """Get Device Status: a response code and the endpoints that are halted; None if it cannot say."""
        try:
            answer = Reader(self.pipe.control_in(_CLASS_IN, _STATUS, 0, 64, _CONTROL_TIMEOUT))
            answer.u16()
            return answer.u16(), tuple(answer.u32() for _ in range(answer.remaining // 4))
        except CameraLost:
            raise
        except CameraError:
            return None

    def _clear_halts(self) -> None:
        """Clear the endpoints that the camera says are halted, both bulk ones if it does not say."""
        status = self._status()
        halted = [end for end in self.pipe.endpoints if status and end.bEndpointAddress in status[1]]
        for endpoint in halted or (self._out, self._in):
            self._ask(partial(self.pipe.clear_halt, endpoint))

    def _settled(self) -> bool:
        """Wait until the camera no longer says that it is busy; whether it stopped."""
        end, pause = self._clock.now() + _SETTLE_SECONDS, 0.01
        while (status := self._status()) is not None and status[0] == ResponseCode.DEVICE_BUSY:
            if self._clock.now() >= end:
                return False
            self._clock.sleep(pause)
            pause = min(2 * pause, 0.2)
        return True

    def _drain(self) -> bool:
        """Throw away what still comes in; whether it stopped coming."""
        for _ in range(_MOST_READS):
            try:
                self._read(_DRAIN_TIMEOUT)
            except CameraTimeout:
                return True
            except EndpointStalled:
                self._clear_halts()
            except CameraLost:
                raise
            except CameraProtocol:
                continue
        return False

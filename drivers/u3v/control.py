"""The memory of a USB3 Vision device, read and written through its control interface."""

from drivers.clock import Clock
from drivers.errors import (
    CameraBusy,
    CameraProtocol,
    CameraRefused,
    CameraTimeout,
)
from drivers.u3v import gencp
from drivers.u3v.gencp import Code, Packet, Status
from drivers.usb import EndpointStalled, UsbPipe

ATTEMPTS = 5
_FIRST_LIMIT = 256
"""Largest packet before the device has said what it takes: enough for one bootstrap string."""
_PATIENCE = 0.5
"""Seconds for an answer before the device has said how long it may need."""
_LONGEST_PENDING = 30.0
"""Seconds after which a device that only ever asks for more time is taken for hung."""
_FIRST_PAUSE, _LONGEST_PAUSE, _LONGEST_BUSY = 0.005, 0.02, 0.5
"""Seconds before a busy device is asked again, twice as long after each time up to the second; in all."""

_REFUSED = {
    Status.NOT_IMPLEMENTED: "does not support this command",
    Status.BAD_PARAMETER: "does not take that value",
    Status.BAD_ADDRESS: "has nothing at that address",
    Status.WRITE_PROTECTED: "has this register read-only",
    Status.ACCESS_DENIED: "does not allow this now",
    Status.WRONG_CONFIGURATION: "cannot do this in its current configuration",
    Status.TRANSFERS_UNSUITED: "does not take these transfer sizes",
    Status.TRANSFERS_INCONSISTENT: "finds the transfer sizes inconsistent",
}


class ControlChannel:
    """Reads and writes of any length, split into packets that the device takes; `limit` sets their size.

    Errors: CameraTimeout and CameraProtocol after five attempts, CameraBusy after half a second;
    CameraRefused, CameraLost and the rest of `UsbPipe` at once.
    """

    def __init__(self, pipe: UsbPipe, clock: Clock) -> None:
        self.where = pipe.where
        self._pipe, self._clock = pipe, clock
        self._out = pipe.endpoint(into_host=False)
        self._in = pipe.endpoint(into_host=True)
        self._command_limit = self._answer_limit = _FIRST_LIMIT
        self._patience = _PATIENCE
        self._id = 0

    def limit(self, command: int, answer: int, patience: float) -> None:
        """The device's largest packets, bytes, and its longest response time, s."""
        if command <= gencp.WRITE_OVERHEAD or answer <= gencp.HEADER_SIZE:
            raise CameraProtocol(
                f"{self.where} reports packets of {command} and {answer} bytes: reset the camera."
            )
        # The size of a packet's payload is a number of 16 bits; whole words keep every part aligned.
        self._command_limit = min(command, 0xFFFF)
        self._answer_limit = min(answer, 0xFFFF)
        self._patience = max(patience, 0.1)

    def read(self, address: int, size: int) -> bytes:
        """`size` bytes from `address`."""
        most = _whole_words(self._answer_limit - gencp.HEADER_SIZE)
        parts = []
        for start in range(0, size, most):
            want = min(most, size - start)
            payload = gencp.read_payload(address + start, want)
            part = self._ask(Code.READ, payload, Code.READ_ACK)
            if len(part) != want:
                raise CameraProtocol(
                    f"{self.where} sent {len(part)} bytes of memory instead of {want}: reset the camera."
                )
            parts.append(part)
        return b"".join(parts)

    def write(self, address: int, data: bytes) -> None:
        """Write `data` to `address`."""
        most = _whole_words(self._command_limit - gencp.WRITE_OVERHEAD)
        for start in range(0, len(data), most):
            part = data[start : start + most]
            answer = self._ask(Code.WRITE, gencp.write_payload(address + start, part), Code.WRITE_ACK)
            # Some devices leave the count out.
            written = gencp.parse_number_payload(answer) if answer else len(part)
            if written != len(part):
                raise CameraProtocol(
                    f"{self.where} wrote {written} bytes of memory instead of {len(part)}: reset the camera."
                )

    def read_number(self, address: int, size: int) -> int:
        """An unsigned little-endian number."""
        return int.from_bytes(self.read(address, size), "little")

    def write_number(self, address: int, size: int, value: int) -> None:
        """An unsigned little-endian number."""
        self.write(address, value.to_bytes(size, "little"))

    def _ask(self, code: Code, payload: bytes, answer: Code) -> bytes:
        """The payload of the answer, tried again where that can help."""
        pause, failures = _FIRST_PAUSE, 0
        patient_until = self._clock.now() + _LONGEST_BUSY
        while True:
            try:
                return self._exchange(code, payload, answer)
            except CameraBusy:
                if self._clock.now() >= patient_until:
                    raise
                self._clock.sleep(pause)
                pause = min(2 * pause, _LONGEST_PAUSE)
            except (CameraTimeout, CameraProtocol) as error:
                failures += 1
                if failures == ATTEMPTS:
                    raise
                if isinstance(error, EndpointStalled):
                    self._pipe.clear_halt(self._out)
                    self._pipe.clear_halt(self._in)

    def _exchange(self, code: Code, payload: bytes, answer: Code) -> bytes:
        """One command and its answer."""
        self._id = self._id % 0xFFFF + 1
        packet = Packet(gencp.ACKNOWLEDGE, code, self._id, payload).pack()
        self._pipe.write(self._out, packet, self._patience)
        began = self._clock.now()
        deadline = began + self._patience
        while (remaining := deadline - self._clock.now()) > 0:
            data = self._pipe.read(self._in, self._answer_limit, remaining)
            if not data:
                continue  # The zero-length packet that ended the transfer before.
            try:
                reply = Packet.parse(data)
            except CameraProtocol as error:
                raise CameraProtocol(f"{self.where}: {error}") from error
            if reply.request_id != self._id:
                continue  # A late answer to a command that was given up.
            if reply.code == Code.PENDING_ACK:
                wait = gencp.parse_number_payload(reply.payload) / 1000
                deadline = min(self._clock.now() + wait, began + _LONGEST_PENDING)
                continue
            self._judge(reply.word)
            if reply.code != answer:
                raise CameraProtocol(
                    f"{self.where} answered {code.name} with {reply.code:#06x}: reset the camera."
                )
            return reply.payload
        raise CameraTimeout(f"{self.where} does not answer: reset the camera or unplug it and plug it in.")

    def _judge(self, status: int) -> None:
        """Raise what a status means."""
        if status == Status.SUCCESS:
            return
        if status == Status.BUSY:
            raise CameraBusy(f"{self.where} is busy: wait and try again.")
        if status == Status.TIMEOUT:
            raise CameraTimeout(f"{self.where} ran out of time: try again.")
        if status in _REFUSED:
            raise CameraRefused(f"{self.where} {_REFUSED[Status(status)]}: read its features again.")
        raise CameraProtocol(f"{self.where} answered with status {status:#06x}: reset the camera.")


def _whole_words(size: int) -> int:
    """Down to a multiple of four, as devices want addresses and lengths to be."""
    return max(size - size % 4, 4)

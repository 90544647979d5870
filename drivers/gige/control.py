"""The memory of a GigE Vision device, read and written by GVCP, and the control that one host has of it."""

import itertools
import socket
import struct
import threading
from contextlib import suppress

from drivers.clock import Clock
from drivers.errors import CameraBusy, CameraClaimed, CameraLost, CameraProtocol, CameraRefused, CameraTimeout
from drivers.gige import gvcp
from drivers.gige.gvcp import Answer, Code, Command, Status
from drivers.gige.registers import CONTROL, EXCLUSIVE, Bootstrap
from imaging.errors import CameraError

PATIENCE = (0.1, 0.2, 0.4, 0.8, 1.6)
"""Seconds for an answer, at each attempt: on a cable it takes less than one thousandth."""
_LONGEST_PENDING = 30.0
"""Seconds after which a device that only ever asks for more time is taken for hung."""
_PAUSE, _LONGEST_BUSY = 0.01, 0.5
"""Seconds before a busy device is asked again; in all."""
_LARGEST_DATAGRAM = 2048
_REFUSED = {
    Status.INVALID_PARAMETER: "does not take that value",
    Status.INVALID_ADDRESS: "has nothing at that address",
    Status.WRITE_PROTECTED: "has this register read-only",
    Status.BAD_ALIGNMENT: "has nothing at that address",
    Status.ACCESS_DENIED: "does not allow this now",
}


class _NotImplemented(CameraRefused):
    """A command that the device does not know."""


class ControlChannel:
    """Reads and writes of any length, for any thread.

    Errors: CameraBusy after half a second, CameraProtocol after five attempts, CameraRefused at once;
    CameraLost if it does not answer five times, or its control was released or taken over by another host.
    """

    def __init__(self, address: str, clock: Clock) -> None:
        """The device at an IPv4 address."""
        self.address, self.where = address, f"GigE {address}"
        self._clock = clock
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._lock = threading.Lock()
        self._ids = itertools.cycle(range(1, 0x10000))
        self._lost: str | None = None
        self._stopping = threading.Event()
        self._beating: threading.Thread | None = None
        try:
            self._socket.connect((address, gvcp.PORT))
        except OSError as error:
            self._socket.close()
            raise CameraLost(
                f"{self.where} cannot be reached ({error.strerror}): check the network."
            ) from error
        self.host = str(self._socket.getsockname()[0])
        """The address of ours that the device answers to."""

    def take(self) -> None:
        """Take control of the device, and keep it by asking for it again and again. CameraClaimed."""
        try:
            held = self.read_number(Bootstrap.CONTROL_PRIVILEGE, 4)
            if not held & (CONTROL | EXCLUSIVE):
                self.write_number(Bootstrap.CONTROL_PRIVILEGE, 4, CONTROL)
                held = self.read_number(Bootstrap.CONTROL_PRIVILEGE, 4) ^ CONTROL
        except CameraRefused:
            held = EXCLUSIVE
        if held & (CONTROL | EXCLUSIVE):
            raise CameraClaimed(
                f"{self.where} is held by another program: close it, or wait some seconds if it has crashed."
            )
        timeout = self.read_number(Bootstrap.HEARTBEAT_TIMEOUT, 4) / 1000
        period = min(max(timeout / 4, 0.05), 1.0)
        self._beating = threading.Thread(
            target=self._beat, args=(period,), name="gige heartbeat", daemon=True
        )
        self._beating.start()

    def close(self) -> None:
        """Give the control back; a second time does nothing."""
        self._stopping.set()
        if self._beating is not None:
            self._beating.join()
            self._beating = None
            with self._lock, suppress(CameraError):
                release = struct.pack(">II", Bootstrap.CONTROL_PRIVILEGE, 0)
                self._attempt(Code.WRITE_REGISTER, next(self._ids), release)
        self._socket.close()

    def read(self, address: int, size: int) -> bytes:
        """`size` bytes from `address`."""
        if size == 4 and address % 4 == 0:
            return self._exactly(4, self._ask(Code.READ_REGISTER, struct.pack(">I", address)))
        # Devices read whole words only.
        first, end = address - address % 4, address + size + -(address + size) % 4
        parts = []
        for start in range(first, end, gvcp.MOST_MEMORY):
            want = min(gvcp.MOST_MEMORY, end - start)
            answer = self._ask(Code.READ_MEMORY, gvcp.memory_payload(start, want))
            parts.append(self._exactly(want + 4, answer)[4:])
        return b"".join(parts)[address - first :][:size]

    def write(self, address: int, data: bytes) -> None:
        """Write `data` to `address`; what shares a word with it is read before, and written as it was."""
        try:
            self._write(address, data)
        except CameraRefused:
            if self._beating is not None:
                self._confirm()
            raise

    def _write(self, address: int, data: bytes) -> None:
        if len(data) == 4 and address % 4 == 0:
            # Every device has this command, not every one the other.
            self._ask(Code.WRITE_REGISTER, struct.pack(">I", address) + data)
            return
        first, end = address - address % 4, address + len(data) + -(address + len(data)) % 4
        if (first, end) != (address, address + len(data)):
            around = self.read(first, end - first)
            data = around[: address - first] + data + around[address - first + len(data) :]
        try:
            for start in range(0, len(data), gvcp.MOST_MEMORY):
                part = data[start : start + gvcp.MOST_MEMORY]
                self._ask(Code.WRITE_MEMORY, struct.pack(">I", first + start) + part)
        except _NotImplemented:
            # The command is optional; a word at a time does the same.
            for start in range(0, len(data), 4):
                self._ask(Code.WRITE_REGISTER, struct.pack(">I", first + start) + data[start : start + 4])

    def read_number(self, address: int, size: int) -> int:
        """An unsigned big-endian number."""
        return int.from_bytes(self.read(address, size), "big")

    def write_number(self, address: int, size: int, value: int) -> None:
        """An unsigned big-endian number."""
        self.write(address, value.to_bytes(size, "big"))

    def resend(self, wanted: gvcp.Resend) -> None:
        """Ask for packets of the stream; nothing is waited for."""
        with suppress(OSError):  # the device has gone: who waits for the frame finds out
            self._socket.send(wanted.command(next(self._ids)).pack())

    def _exactly(self, size: int, data: bytes) -> bytes:
        if len(data) != size:
            raise CameraProtocol(
                f"{self.where} sent {len(data)} bytes of memory instead of {size}: reset the camera."
            )
        return data

    def _ask(self, code: Code, payload: bytes) -> bytes:
        """The payload of the answer, tried again where that can help."""
        with self._lock:
            return self._tried(code, payload)

    def _tried(self, code: Code, payload: bytes) -> bytes:
        failures = 0
        patient_until = self._clock.now() + _LONGEST_BUSY
        # The same number each time: devices know what they did already by it, and late answers count.
        request_id = next(self._ids)
        while True:
            if self._lost is not None:
                raise CameraLost(self._lost)
            try:
                return self._attempt(code, request_id, payload, PATIENCE[failures])
            except CameraBusy:
                if self._clock.now() >= patient_until:
                    raise
                self._clock.sleep(_PAUSE)
                request_id = next(self._ids)
            except CameraTimeout as error:
                failures += 1
                if failures == len(PATIENCE):
                    self._lost = str(error)
            except CameraProtocol:
                failures += 1
                if failures == len(PATIENCE):
                    raise

    def _attempt(self, code: Code, request_id: int, payload: bytes, patience: float = PATIENCE[0]) -> bytes:
        """One command and its answer."""
        try:
            self._socket.send(Command(code, request_id, payload).pack())
            return self._answer(code, request_id, patience)
        except TimeoutError:
            raise CameraTimeout(
                f"{self.where} does not answer: check its cable, its power and its address."
            ) from None
        except OSError as error:
            self._stopping.wait(_PAUSE)  # no program listens there at the moment
            raise CameraTimeout(
                f"{self.where} cannot be reached ({error.strerror}): check its cable and its power."
            ) from error

    def _answer(self, code: Code, request_id: int, patience: float) -> bytes:
        began = self._clock.now()
        deadline = began + patience
        while (remaining := deadline - self._clock.now()) > 0:
            self._socket.settimeout(remaining)
            try:
                data = self._socket.recv(_LARGEST_DATAGRAM)
                if gvcp.is_command(data):
                    self._heed(data)
                    continue
                answer = Answer.parse(data)
            except CameraProtocol as error:
                raise CameraProtocol(f"{self.where}: {error}: reset the camera.") from error
            if answer.request_id != request_id:
                continue  # a late answer to a command that was given up
            if answer.code == Code.PENDING_ACK:
                wait = gvcp.parse_number_payload(answer.payload) / 1000
                deadline = min(self._clock.now() + wait + patience, began + _LONGEST_PENDING)
                continue
            self._judge(answer.status)
            if answer.code != code + 1:
                raise CameraProtocol(
                    f"{self.where} answered {code.name} with {answer.code:#06x}: reset the camera."
                )
            return answer.payload
        raise TimeoutError

    def _heed(self, data: bytes) -> None:
        """Acknowledge an event, of which nothing is wanted; another command of the device is left alone."""
        with suppress(CameraProtocol):
            if (answer := gvcp.event_answer(data)) is not None:
                self._socket.send(answer)

    def _judge(self, status: int) -> None:
        """Raise what a status means."""
        if status == Status.SUCCESS:
            return
        if status == Status.BUSY:
            raise CameraBusy(f"{self.where} is busy: wait and try again.")
        if status == Status.NOT_IMPLEMENTED:
            raise _NotImplemented(f"{self.where} does not support this command: update its firmware.")
        if status in _REFUSED:
            raise CameraRefused(f"{self.where} {_REFUSED[Status(status)]}: read its features again.")
        raise CameraProtocol(f"{self.where} answered with status {status:#06x}: reset the camera.")

    def _beat(self, period: float) -> None:
        """Ask for the control again and again: a device whose host falls silent lets it go."""
        while not self._stopping.wait(period):
            try:
                self._confirm()
            except CameraLost:
                return
            except CameraError:
                continue

    def _confirm(self) -> None:
        """Renew the control privilege, which keeps the connection alive. CameraLost if it was taken over."""
        if not self.read_number(Bootstrap.CONTROL_PRIVILEGE, 4) & CONTROL:
            self._lost = f"{self.where} released control, since this host was silent: open it again."
            raise CameraLost(self._lost)

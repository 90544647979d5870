"""A PTP session: operations that end in a value or in one of our errors, properties, objects, events."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from drivers.clock import Clock
from drivers.errors import CameraBusy, CameraLost, CameraProtocol, CameraRefused, CameraTimeout
from drivers.ptp.protocol.codec import Command, Event, Reader, Response, Value, pack_value
from drivers.ptp.protocol.codes import (
    EVERY_FORMAT,
    EVERY_PARENT,
    EVERY_STORAGE,
    UNKNOWN_LENGTH,
    DataType,
    Operation,
    ResponseCode,
)
from drivers.ptp.protocol.datasets import DeviceInfo, DevicePropDesc, ObjectInfo
from drivers.ptp.protocol.refusals import RefusedWith, passing_over
from drivers.ptp.protocol.transaction import MOST_BYTES, TIMEOUT, Answer, ResponseLost, Transport

SESSION = 1
QUICK_TIMEOUT = 8.0
"""Timeout in seconds of the first command, which shows whether the camera responds, and of other quick ones.
"""
PROMPT_TIMEOUT = 2.0
"""Seconds after which what needs no thought is asked once more: an answer was lost. Cards block some bodies
for more than a second."""
READY_TIMEOUT = 4.0
"""Seconds for what a camera begins at once when it is ready: an exposure without autofocus, or sending a
picture that lies in its memory."""
PATIENCE = 8.0
"""Seconds for which a busy camera is asked again."""
_LONGEST_PAUSE = 0.02
"""Seconds between two questions to a busy camera; libgphoto2 asks Nikons as often."""
PIECE = 1 << 20
"""Bytes of one partial download; 5 MiB crash a Canon EOS R."""

_REPEATABLE = frozenset(
    {
        Operation.GET_DEVICE_INFO,
        Operation.GET_STORAGE_IDS,
        Operation.GET_STORAGE_INFO,
        Operation.GET_NUM_OBJECTS,
        Operation.GET_OBJECT_HANDLES,
        Operation.GET_OBJECT_INFO,
        Operation.GET_OBJECT,
        Operation.GET_PARTIAL_OBJECT,
        Operation.GET_DEVICE_PROP_DESC,
        Operation.GET_DEVICE_PROP_VALUE,
        Operation.SET_DEVICE_PROP_VALUE,
    }
)
_QUICK = frozenset(
    {
        Operation.GET_DEVICE_INFO,
        Operation.GET_OBJECT_INFO,
        Operation.GET_DEVICE_PROP_DESC,
        Operation.GET_DEVICE_PROP_VALUE,
        Operation.SET_DEVICE_PROP_VALUE,
    }
)
"""Operations that a camera answers immediately."""
_SLOW = frozenset({Operation.GET_OBJECT, Operation.GET_PARTIAL_OBJECT, Operation.GET_OBJECT_HANDLES})
"""Operations that take a camera long: reading a card."""
_GONE = {ResponseCode.SESSION_NOT_OPEN, ResponseCode.INVALID_TRANSACTION_ID}
_TORN = {ResponseCode.INCOMPLETE_TRANSFER, ResponseCode.TRANSACTION_CANCELLED}

T = TypeVar("T")


@dataclass
class Download:
    """An object on its way: what came already is not fetched again, not even in another session."""

    handle: int
    info: ObjectInfo
    data: bytearray


class PtpSession:
    """One open session on a transport. All errors are CameraError; after CameraLost it is of no more use."""

    def __init__(self, transport: Transport, clock: Clock) -> None:
        self.transport, self.clock = transport, clock
        self.where = transport.where
        self._transaction = 0
        self._types: dict[int, DataType] = {}
        self.info = DeviceInfo()
        self.has_mode = False
        """True once the camera was put into its maker's mode, which ends with the session."""
        self._mode_lost = False

    def open(self) -> DeviceInfo:
        """Open the session, then ask who is there; in this order some responders insist on it."""
        try:
            self._begin()
            self.info = DeviceInfo.unpack(self.get(Operation.GET_DEVICE_INFO))
        except BaseException:
            self.transport.close()
            raise
        return self.info

    def supports(self, operation: int) -> bool:
        """Return whether the camera lists an operation."""
        return operation in self.info.operations

    def run(
        self,
        operation: int,
        *parameters: int,
        data: bytes | None = None,
        timeout: float | None = None,
        most: int = MOST_BYTES,
        repeatable: bool | None = None,
        patience: float = PATIENCE,
        prompt: float | None = None,
    ) -> Answer:
        """Run an operation until the camera says OK.

        Busy is asked again for `patience` seconds, then CameraBusy. An operation that may be done twice
        is done once more after an error that the connection survived, or `prompt` seconds without an answer;
        if not given, that is PROMPT_TIMEOUT but for what takes long. CameraRefused for other answers.
        """
        limit = timeout or (QUICK_TIMEOUT if operation in _QUICK else TIMEOUT)
        first = prompt or (limit if operation in _SLOW else PROMPT_TIMEOUT)
        may_repeat = operation in _REPEATABLE if repeatable is None else repeatable

        def attempt(limit: float) -> Answer:
            if self._mode_lost:
                raise CameraLost(f"{self.where} dropped the session, and left remote control: try again.")
            command = Command(operation, self._next(), parameters)
            reply = self._recovered(command, data, limit, most)
            code = reply.response.code
            if code in _GONE:
                self._reopen()
                raise CameraProtocol(f"{self.where} had dropped the session: try again.")
            if code in _TORN:
                raise CameraProtocol(f"{self.where} broke operation 0x{operation:04X} off: try again.")
            return reply

        def insisting() -> Answer:
            if not may_repeat:
                return attempt(limit)
            try:
                return attempt(min(limit, first))
            except (CameraProtocol, CameraTimeout):
                return attempt(limit)

        return self._patiently(operation, insisting, patience)

    def get(
        self,
        operation: int,
        *parameters: int,
        timeout: float | None = None,
        most: int = MOST_BYTES,
        prompt: float | None = None,
    ) -> bytes:
        """Run an operation that answers with data, and may be run twice; CameraProtocol if it sends none."""
        reply = self.run(operation, *parameters, timeout=timeout, most=most, repeatable=True, prompt=prompt)
        data = reply.data
        if data is None:
            raise CameraProtocol(f"{self.where} sent nothing for operation 0x{operation:04X}: try again.")
        return data

    def describe(self, code: int) -> DevicePropDesc:
        """A property: its type, value and choices."""
        description = DevicePropDesc.unpack(self.get(Operation.GET_DEVICE_PROP_DESC, code))
        if description.code != code:
            raise CameraProtocol(
                f"{self.where} described property 0x{description.code:04X}, not 0x{code:04X}."
            )
        self._types[code] = description.data_type
        return description

    def write_property(self, code: int, value: Value) -> None:
        """Set a property; CameraRefused if the value does not fit its type or the camera will not."""
        kind = self._type(code)
        try:
            packed = pack_value(kind, value)
        except ValueError as error:
            raise CameraRefused(f"{self.where} has no value {value!r} of property 0x{code:04X}.") from error
        self.run(Operation.SET_DEVICE_PROP_VALUE, code, data=packed)

    def handles(self) -> tuple[int, ...]:
        """The handles of all objects in all storages, storage by storage where it must be."""
        try:
            return self._handles(EVERY_STORAGE)
        except RefusedWith as error:
            if error.code != ResponseCode.INVALID_STORAGE_ID:
                raise
        storages = Reader(self.get(Operation.GET_STORAGE_IDS)).array(DataType.UINT32)
        return tuple(handle for storage in storages for handle in self._handles(storage))

    def _handles(self, storage: int) -> tuple[int, ...]:
        data = bytes(4)  # an empty array, where there is no card
        with passing_over(ResponseCode.STORE_NOT_AVAILABLE):
            data = self.get(Operation.GET_OBJECT_HANDLES, storage, EVERY_FORMAT, EVERY_PARENT)
        return Reader(data).array(DataType.UINT32)

    def object_info(self, handle: int) -> ObjectInfo:
        """Return what an object is."""
        return ObjectInfo.unpack(self.get(Operation.GET_OBJECT_INFO, handle))

    def download(self, file: Download) -> bytes:
        """All of an object; in pieces where the camera can, so that an error costs one piece.

        After an error, also in another session, the same Download goes on where it stopped.
        """
        size = file.info.size
        if size == UNKNOWN_LENGTH or not self.supports(Operation.GET_PARTIAL_OBJECT):
            most = 1 << 32 if size == UNKNOWN_LENGTH else max(size, 1)
            data = self.get(Operation.GET_OBJECT, file.handle, most=most)
            file.data[:] = data
        else:
            self.pieces(file, lambda offset, count: self._piece(file.handle, offset, count))
        if size != UNKNOWN_LENGTH and len(file.data) != size:
            raise CameraProtocol(
                f"{self.where} sent {len(file.data)} of {size} bytes of {file.info.filename}."
            )
        return bytes(file.data)

    def pieces(self, file: Download, fetch: Callable[[int, int], bytes]) -> None:
        """Fill a Download by `fetch(offset, count)`, which may return less.

        CameraProtocol if it is empty, or the file ends beyond 4 GiB, where offsets of 32 bits do not reach.
        """
        if file.info.size >= 1 << 32:
            raise CameraProtocol(
                f"{self.where} reports {file.info.filename} with {file.info.size >> 20} MiB, too large for "
                "a picture: shoot it again, and switch off movies in its menu."
            )
        while len(file.data) < file.info.size:
            count = min(PIECE, file.info.size - len(file.data))
            piece = fetch(len(file.data), count)
            if not 0 < len(piece) <= count:
                raise CameraProtocol(f"{self.where} sent {len(piece)} bytes where {count} were asked for.")
            file.data += piece

    def events(self, timeout: float) -> list[Event]:
        """Events that came, or come within `timeout` seconds."""
        return self.transport.events(timeout)

    def close(self) -> None:
        """Close the session, as far as the camera still listens, and let go."""
        try:
            self.transport.transact(Command(Operation.CLOSE_SESSION, self._next()), timeout=2.0)
        except (CameraLost, CameraProtocol, CameraTimeout):
            pass
        finally:
            self.transport.close()

    def _piece(self, handle: int, offset: int, count: int) -> bytes:
        return self.get(Operation.GET_PARTIAL_OBJECT, handle, offset, count, most=count)

    def _type(self, code: int) -> DataType:
        return self._types[code] if code in self._types else self.describe(code).data_type

    def _next(self) -> int:
        self._transaction = self._transaction % (UNKNOWN_LENGTH - 1) + 1  # never 0 nor 0xFFFFFFFF
        return self._transaction

    def _recovered(self, command: Command, data: bytes | None, timeout: float, most: int) -> Answer:
        """A transaction; one that fails leaves a pipe and a session that can go on."""
        try:
            return self.transport.transact(command, data, timeout=timeout, most=most)
        except (CameraProtocol, CameraTimeout) as error:
            if not self.transport.recover(error, command.transaction):
                self._reopen()
            if isinstance(error, ResponseLost):  # events and pictures in memory are not sent twice
                return Answer(Response(ResponseCode.OK, command.transaction), error.data)
            raise

    def _reopen(self) -> None:
        """Open a session in place of one that ended; a mode that ended with it takes a new connection."""
        self._begin()
        self._mode_lost = self.has_mode

    def _begin(self) -> None:
        """OpenSession; a session that somebody left open is closed first, by a reset if it must be."""
        for recover in (self._close_stale, self.transport.reset, None):
            reply = self._open_once()
            if reply.response.code == ResponseCode.OK:
                self._transaction = 0
                return
            if reply.response.code != ResponseCode.SESSION_ALREADY_OPENED or recover is None:
                raise RefusedWith(self.where, Operation.OPEN_SESSION, reply.response.code)
            try:
                recover()
            except (CameraProtocol, CameraTimeout):
                continue

    def _open_once(self) -> Answer:
        command = Command(Operation.OPEN_SESSION, 0, (SESSION,))

        def attempt() -> Answer:
            try:
                return self.transport.transact(command, timeout=QUICK_TIMEOUT)
            except (CameraProtocol, CameraTimeout) as error:
                self.transport.recover(error, 0)
                return self.transport.transact(command, timeout=QUICK_TIMEOUT)

        return self._patiently(Operation.OPEN_SESSION, attempt, PATIENCE, accept=True)

    def _close_stale(self) -> None:
        self.transport.transact(Command(Operation.CLOSE_SESSION, self._next()), timeout=QUICK_TIMEOUT)

    def _patiently(
        self, operation: int, attempt: Callable[[], Answer], patience: float, *, accept: bool = False
    ) -> Answer:
        """Attempts until the camera is no longer busy; `accept` any answer but Busy, else only OK."""
        end, pause = None, 0.005
        while True:
            reply = attempt()
            code = reply.response.code
            if code == ResponseCode.OK:
                return reply
            if code not in (ResponseCode.DEVICE_BUSY, ResponseCode.BULB_RELEASE_BUSY):
                if accept:
                    return reply
                raise RefusedWith(self.where, operation, code)
            end = self.clock.now() + patience if end is None else end  # time-outs before do not count
            if self.clock.now() >= end:
                fix = "let it finish writing, or switch it off and on"
                if code == ResponseCode.BULB_RELEASE_BUSY:
                    fix = "its shutter is open in bulb mode: end the exposure, and turn its dial to M"
                raise CameraBusy(f"{self.where} stays busy: {fix}.")
            self.clock.sleep(pause)
            pause = min(1.5 * pause, _LONGEST_PAUSE)

"""Canon EOS: remote and event mode, properties by way of events, pictures to the host.

Source: libgphoto2's codes and layout of event records; what an EOS 6D and an R6 sent (its dumps).
Verified against: the simulated cameras, which follow the same notes; no hardware. Left out: setting the image
format (choose RAW in the camera's menu), bulb, live view, autofocus and its result.
"""

import struct
from collections.abc import Generator
from contextlib import suppress
from dataclasses import replace

from drivers.errors import CameraBusy, CameraProtocol, CameraRefused, CameraTimeout
from drivers.ptp.autobracket import AutoBracket
from drivers.ptp.exposure import CANON_DIALS, Dial
from drivers.ptp.protocol.codec import Reader, Value
from drivers.ptp.protocol.codes import (
    CanonEvent,
    CanonOperation,
    CanonProperty,
    DataType,
    Operation,
    ResponseCode,
)
from drivers.ptp.protocol.datasets import DevicePropDesc, EnumForm
from drivers.ptp.protocol.refusals import RefusedWith
from drivers.ptp.protocol.session import PATIENCE, QUICK_TIMEOUT, Download
from drivers.ptp.vendors.canon_records import OBJECTS, unpack_object, unpack_records
from drivers.ptp.vendors.standard import StandardBody
from drivers.ptp.waiting import GRACE, deadline

TO_HOST = 4
_CAPACITY = (0x0FFFFFFF, 0x1000, 1)
"""Free clusters, bytes of a cluster, reset: room on the host, without which nothing is shot."""
_LIST = 3
_IMAGE_FORMAT = struct.pack("<I", CanonProperty.IMAGE_FORMAT)
"""Beginning of the image format's records; the number of files of a shot follows."""
_PAUSE = 0.05
_READERS = (
    CanonOperation.GET_PARTIAL_OBJECT,
    CanonOperation.GET_PARTIAL_OBJECT_64,
    Operation.GET_PARTIAL_OBJECT,
)
"""Operations that read a piece of a file: the first that a body lists and does not refuse is used. All take
handle, offset and count.
"""
_NOT_THIS_WAY = {
    ResponseCode.OPERATION_NOT_SUPPORTED,
    ResponseCode.PARAMETER_NOT_SUPPORTED,
    ResponseCode.INVALID_OBJECT_HANDLE,
    ResponseCode.INVALID_PARAMETER,
}
_MOST_BATCHES = 64
_READ_BACKS = 5
_HALF, _FULL = 1, 2
_SINGLE, _CONTINUOUS, _AEB_OFF = 0, 1, 0
_BRACKETS = tuple(
    AutoBracket(code, thirds, 3)
    for thirds, code in enumerate((0x03, 0x05, 0x08, 0x0B, 0x0D, 0x10, 0x13, 0x15, 0x18), 1)
)
"""AEB by thirds of a stop. It has three frames, unless the photographer chose another number in the camera's
menu, which it does not report.
"""


class CanonBody(StandardBody):
    """An EOS DSLR or R."""

    releases = (CanonOperation.REMOTE_RELEASE_ON, CanonOperation.REMOTE_RELEASE)

    knows_make = True
    remembers = False

    def enter(self) -> None:
        """Remote mode, event mode, all properties, the host as the destination."""
        self._properties: dict[int, DevicePropDesc] = {}
        self._added: list[Download] = []
        self._untaken: dict[int, Download] = {}
        """Objects announced and not yet released, by handle."""
        self._files: int | None = None
        """Number of files of a shot, as the image format has it; None until the body reports it."""
        listed = tuple(reader for reader in _READERS if self.session.supports(reader))
        self._readers: tuple[int, ...] = listed or _READERS[:1]
        self.session.has_mode = True
        self.session.run(CanonOperation.SET_REMOTE_MODE, 1, repeatable=True)
        self.session.run(CanonOperation.SET_EVENT_MODE, 1, repeatable=True)
        self._listen()
        self.write(CanonProperty.CAPTURE_DESTINATION, TO_HOST)
        with suppress(CameraBusy):  # libgphoto2 goes on too; the shot would show it
            self.session.run(CanonOperation.PC_HDD_CAPACITY, *_CAPACITY, repeatable=True)
        self._listen()
        if self._description(CanonProperty.AEB).current != _AEB_OFF:  # a bracket that broke off left it so
            self.write(CanonProperty.AEB, _AEB_OFF)
        self.time, self.f_number, self.iso = (Dial(self, *setting) for setting in CANON_DIALS)

    def leave(self) -> None:
        """Event and remote mode off, so that the camera's own buttons work again."""
        self.session.run(CanonOperation.SET_EVENT_MODE, 0, repeatable=True)
        self.session.run(CanonOperation.SET_REMOTE_MODE, 0, repeatable=True)

    def delivers_raw(self) -> bool:
        """All that are meant here do."""
        return True

    def describe(self, code: int) -> DevicePropDesc:
        """Return what the camera's events last said of a property; CameraRefused if they never did."""
        self._listen()
        try:
            return self._properties[code]
        except KeyError:
            raise CameraRefused(
                f"{self.session.where} does not report property 0x{code:04X}: turn its mode dial to M."
            ) from None

    def write(self, code: int, value: Value) -> None:
        """Set a property of one number."""
        if not isinstance(value, int) or not 0 <= value < 1 << 32:
            raise CameraRefused(f"{self.session.where} has no value {value!r} of property 0x{code:04X}.")
        packed = struct.pack("<3I", 12, code, value)
        self.session.run(CanonOperation.SET_DEVICE_PROP_VALUE_EX, data=packed, repeatable=True)

    def wait_ready(self) -> None:
        """Keep it awake and discard its events of earlier shots."""
        if self.session.supports(CanonOperation.KEEP_DEVICE_ON):
            self.session.run(CanonOperation.KEEP_DEVICE_ON, repeatable=True)
        self._listen()
        for file in self._added:
            self.discard(file)
        self._added.clear()
        super().wait_ready()

    def recount(self) -> None:
        """Get rid of what failed shots left in its memory: it would stay busy for ever."""
        for file in tuple(self._untaken.values()):
            self.discard(file)
        self._added.clear()

    def release(self, patience: float = PATIENCE) -> None:
        """Half and full press, and up again; one command on old bodies."""
        if not self.session.supports(CanonOperation.REMOTE_RELEASE_ON):
            self.session.run(CanonOperation.REMOTE_RELEASE, repeatable=False, patience=patience)
            return
        self.session.run(CanonOperation.REMOTE_RELEASE_ON, _HALF, repeatable=True, patience=patience)
        try:
            self.session.run(CanonOperation.REMOTE_RELEASE_ON, _FULL, repeatable=False, patience=patience)
            self.session.run(CanonOperation.REMOTE_RELEASE_OFF, _FULL, repeatable=True)
        finally:
            self.session.run(CanonOperation.REMOTE_RELEASE_OFF, _HALF, repeatable=True)

    def wait(self, exposure: float) -> list[Download]:
        """Wait until its events announce all files of a shot, or until no more come for a moment."""
        clock = self.session.clock
        end = clock.now() + deadline(exposure)
        clock.sleep(exposure)  # a query meanwhile returns nothing
        files, news = [], clock.now()
        while clock.now() < end:
            self._listen()
            if self._added:
                files += self._added
                self._added, news = [], clock.now()
            if files and (len(files) == self._files or clock.now() - news >= GRACE):
                return files
            clock.sleep(_PAUSE)
        raise CameraTimeout(f"{self.session.where} delivered no picture: check its focus and mode dial.")

    def auto_brackets(self) -> tuple[AutoBracket, ...]:
        """AEB of a body with continuous shooting and a button that can be held down.

        None for RAW+JPEG, whose files could not be assigned.
        """
        self._listen()
        if self._files is not None and self._files > 1:
            return ()
        aeb, drive = (self._offered(code) for code in (CanonProperty.AEB, CanonProperty.DRIVE_MODE))
        if _CONTINUOUS not in drive or not self.session.supports(CanonOperation.REMOTE_RELEASE_ON):
            return ()
        return tuple(bracket for bracket in _BRACKETS if bracket.code in aeb)

    def set_auto_bracket(self, bracket: AutoBracket | None) -> None:
        """AEB in continuous shooting, in which one press takes all frames."""
        for code, wanted in (
            (CanonProperty.DRIVE_MODE, _SINGLE if bracket is None else _CONTINUOUS),
            (CanonProperty.AEB, _AEB_OFF if bracket is None else bracket.code),
        ):
            self.write(code, wanted)
            for _ in range(_READ_BACKS):
                if self.describe(code).current == wanted:
                    break
                self.session.clock.sleep(_PAUSE)
            else:
                raise CameraRefused(f"{self.session.where} keeps its drive mode or AEB: set its dial to M.")

    def shoot_bracket(self, bracket: AutoBracket, seconds: float) -> Generator[Download, None, None]:
        """The button is held down until all frames are there."""
        clock = self.session.clock
        end = clock.now() + deadline(seconds)
        self.session.run(CanonOperation.REMOTE_RELEASE_ON, _HALF, repeatable=True)
        try:
            self.session.run(CanonOperation.REMOTE_RELEASE_ON, _FULL, repeatable=False)
            for _ in range(bracket.frames):
                self._listen()
                while not self._added:
                    if clock.now() >= end:
                        raise CameraTimeout(f"{self.session.where} broke its bracket off: check its menu.")
                    clock.sleep(_PAUSE)
                    self._listen()
                yield self._added.pop(0)
        finally:
            for half in (_FULL, _HALF):
                self.session.run(CanonOperation.REMOTE_RELEASE_OFF, half, repeatable=True)

    def fetch(self, file: Download) -> bytes:
        """Fetch in pieces of 1 MiB at most."""
        self.session.pieces(file, lambda offset, count: self._piece(file.handle, offset, count))
        return bytes(file.data)

    def discard(self, file: Download) -> None:
        """TransferComplete, else the next shot finds the camera busy."""
        self._untaken.pop(file.handle, None)
        with suppress(CameraRefused):
            self.session.run(CanonOperation.TRANSFER_COMPLETE, file.handle, repeatable=True)

    def _piece(self, handle: int, offset: int, count: int) -> bytes:
        *others, last = self._readers
        for reader in others:
            try:
                data = self.session.get(reader, handle, offset, count, most=count)
            except RefusedWith as error:
                if error.code not in _NOT_THIS_WAY:
                    raise
            else:
                self._readers = (reader,)
                return data
        return self.session.get(last, handle, offset, count, most=count)

    def _listen(self) -> None:
        """Read all waiting event records."""
        for _ in range(_MOST_BATCHES):
            data = self.session.get(CanonOperation.GET_EVENT, timeout=QUICK_TIMEOUT)
            records = list(unpack_records(data))
            for kind, payload in records:
                self._take(kind, payload)
            if not records:
                return
        raise CameraProtocol(f"{self.session.where} sends events without end: switch it off and on.")

    def _take(self, kind: int, payload: bytes) -> None:
        if kind in OBJECTS:
            file = unpack_object(kind, payload)
            self._added.append(file)
            self._untaken[file.handle] = file
        elif kind == CanonEvent.PROP_VALUE_CHANGED and payload[:4] == _IMAGE_FORMAT and len(payload) >= 8:
            self._files = int.from_bytes(payload[4:8], "little")
        elif kind == CanonEvent.PROP_VALUE_CHANGED and 4 < len(payload) <= 8:
            description = self._description(int.from_bytes(payload[:4], "little"))
            self._properties[description.code] = replace(
                description, current=int.from_bytes(payload[4:], "little")
            )
        elif kind == CanonEvent.AVAILABLE_LIST_CHANGED and len(payload) >= 12:
            reader = Reader(payload)
            description, form, count = self._description(reader.u32()), reader.u32(), reader.u32()
            if form == _LIST and reader.remaining >= 4 * count:
                choices = EnumForm(tuple(reader.u32() for _ in range(count)))
                self._properties[description.code] = replace(description, form=choices)

    def _offered(self, code: int) -> tuple[Value, ...]:
        """Return what a property may be set to, by the events so far."""
        form = self._description(code).form
        return form.values if isinstance(form, EnumForm) else ()

    def _description(self, code: int) -> DevicePropDesc:
        return self._properties.get(code) or DevicePropDesc(code, DataType.UINT32, True, 0, 0)

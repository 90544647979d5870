"""Nikon: remote mode, RAW into the camera's memory, DeviceReady and GetEvent by polling.

Source: libgphoto2's codes, and the property lists of a Z 6, a D780 and 60 older bodies (its dumps). Verified
against: the simulated cameras, which follow the same notes; no hardware. Left out: bulb, live view, Wi-Fi
pairing. A body that lists none of Nikon's operations is spoken to in plain PTP.
"""

from collections.abc import Generator
from contextlib import suppress

from drivers.errors import CameraLost, CameraRefused, CameraTimeout
from drivers.ptp.autobracket import AutoBracket
from drivers.ptp.exposure import NIKON_ISO, NIKON_TIME
from drivers.ptp.picture import has_raw
from drivers.ptp.protocol.codec import Event, Reader, Value, damaged
from drivers.ptp.protocol.codes import (
    UNKNOWN_LENGTH,
    DataType,
    EventCode,
    NikonEvent,
    NikonOperation,
    NikonProperty,
    Operation,
    PropertyCode,
    ResponseCode,
)
from drivers.ptp.protocol.datasets import EnumForm
from drivers.ptp.protocol.refusals import passing_over
from drivers.ptp.protocol.session import PATIENCE, PROMPT_TIMEOUT, QUICK_TIMEOUT, READY_TIMEOUT, Download
from drivers.ptp.vendors import nikon_brackets
from drivers.ptp.vendors.standard import StandardBody
from drivers.ptp.waiting import LATE, deadline
from imaging.errors import CameraError

MEMORY_HANDLE = 0xFFFF0001
"""Handle of a picture in the camera's memory."""
_TO_MEMORY, _NO_AUTOFOCUS = 1, 0xFFFFFFFF
_PAUSE, _ASK_AFTER = 0.05, 1.0
_POLL_TIMEOUT = 1.0
"""Seconds after which DeviceReady and GetEvent are asked once more: they are made to be asked while the body
is busy with other things, so that an answer that has not come is lost."""
_SINGLE, _CONTINUOUS = 1, 2
_READ_BACKS = 5
_MEMORY_RELEASES = (
    NikonOperation.INITIATE_CAPTURE_REC_IN_MEDIA,
    NikonOperation.INITIATE_CAPTURE_REC_IN_SDRAM,
)


def nef_setting(values: tuple[Value, ...]) -> int | None:
    """The CompressionSetting that means NEF alone, by those that a body lists; None if it has none.

    What lies above is NEF+JPEG. By libgphoto2's tables and the lists of its dumps: 7 since the D500, which
    counts two kinds of each JPEG; 3 of bodies as the D40 and the D200, which write no TIFF; else 4.
    """
    numbers = [value for value in values if isinstance(value, int)]
    most = max(numbers, default=0)
    nef = 7 if most > 7 else 3 if 3 in numbers and most < 7 else 4
    return nef if nef in numbers else None


def unpack_events(data: bytes) -> list[Event]:
    """Nikon's GetEvent: a count, and for each event its code and one parameter; CameraProtocol."""
    reader = Reader(data)
    count = reader.u16()
    if 6 * count > reader.remaining:
        raise damaged(f"{count} events in {reader.remaining} bytes")
    return [Event(reader.u16(), 0, (reader.u32(),)) for _ in range(count)]


class NikonBody(StandardBody):
    """A Nikon DSLR or Z."""

    releases = (*_MEMORY_RELEASES, Operation.INITIATE_CAPTURE)
    _files = 1
    """Number of files of a shot: two on a body that is set to NEF+JPEG."""

    @property
    def _to_memory(self) -> bool:
        """Return whether pictures go to the camera's memory, from where they must be deleted before the
        next.
        """
        return any(self.session.supports(operation) for operation in _MEMORY_RELEASES)

    @property
    def knows_make(self) -> bool:
        """Return whether it lists Nikon's own operations."""
        return any(self.session.supports(operation) for operation in NikonOperation)

    @property
    def remembers(self) -> bool:
        """Return whether a new session can fetch a shot; not known of pictures in memory."""
        return not self._to_memory

    def enter(self) -> None:
        """Remote mode, memory as the destination, NEF as the format unless it is set to NEF+JPEG."""
        if self.session.supports(NikonOperation.GET_VENDOR_PROP_CODES):
            vendor_codes = Reader(self.session.get(NikonOperation.GET_VENDOR_PROP_CODES)).array(
                DataType.UINT16
            )
            self.listed = (*self.listed, *vendor_codes)
        super().enter()
        self._change_mode(1)
        if self._to_memory and NikonProperty.RECORDING_MEDIA in self.listed:
            self.write(NikonProperty.RECORDING_MEDIA, _TO_MEMORY)
        if PropertyCode.COMPRESSION_SETTING in self.listed:
            self._choose_format()
        fine = self._dial(NIKON_TIME)
        if fine is not None and self.describe(fine.code).writable:
            self.time = fine  # exact, where ExposureTime counts 100 us
        self.iso = self._dial(NIKON_ISO) or self.iso
        if self._stands_at(NikonProperty.BRACKET_ENABLE, 1):  # a bracket that broke off left it so
            with suppress(CameraRefused):
                self.set_auto_bracket(None)

    def leave(self) -> None:
        """Local mode."""
        self._change_mode(0)

    def delivers_raw(self) -> bool:
        """All that are meant here do."""
        return True

    def wait_ready(self) -> None:
        """DeviceReady, and the events of earlier shots forgotten."""
        self._until_ready(PATIENCE)
        if self.session.supports(NikonOperation.GET_EVENT):
            for event in self._events():
                if event.code == NikonEvent.OBJECT_ADDED_IN_SDRAM:
                    self._forget(event.parameters[0] or MEMORY_HANDLE)
        super().wait_ready()

    def recount(self) -> None:
        """Also free the memory of what a shot that failed may have left."""
        super().recount()
        if self._to_memory:
            self._until_ready(PATIENCE)
            self._forget(MEMORY_HANDLE)

    def release(self, patience: float = PATIENCE) -> None:
        """Release without autofocus, into the camera's memory."""
        order: tuple[int, ...]
        if self.session.supports(NikonOperation.INITIATE_CAPTURE_REC_IN_MEDIA):
            order = (NikonOperation.INITIATE_CAPTURE_REC_IN_MEDIA, _NO_AUTOFOCUS, _TO_MEMORY)
        elif self._to_memory:
            order = (NikonOperation.INITIATE_CAPTURE_REC_IN_SDRAM, _NO_AUTOFOCUS)
        else:
            super().release(patience)
            return
        self.session.run(*order, timeout=READY_TIMEOUT, patience=patience, repeatable=False)

    def wait(self, exposure: float) -> list[Download]:
        """Wait until it is ready and has announced a picture."""
        if not (self._to_memory and self.session.supports(NikonOperation.GET_EVENT)):
            return super().wait(exposure)
        clock = self.session.clock
        end = clock.now() + deadline(exposure)
        clock.sleep(exposure)  # a query meanwhile returns nothing
        self._until_ready(deadline(exposure))
        ask_at = clock.now() + _ASK_AFTER
        files, news = list[Download](), clock.now()
        while clock.now() < end:
            handles = [
                event.parameters[0] or MEMORY_HANDLE
                for event in self._events()
                if event.code in (NikonEvent.OBJECT_ADDED_IN_SDRAM, EventCode.OBJECT_ADDED)
            ]
            if not handles and clock.now() >= ask_at:
                # The event may be lost.
                handles, ask_at = [MEMORY_HANDLE], clock.now() + _ASK_AFTER
            for handle in handles:
                if len(files) < self._files and self._takes(handle, files):
                    news = clock.now()
            if len(files) == self._files or (has_raw(files) and clock.now() - news >= LATE):
                return files
            clock.sleep(_PAUSE)
        raise CameraTimeout(f"{self.session.where} delivered no picture: check its focus and mode dial.")

    def auto_brackets(self) -> tuple[AutoBracket, ...]:
        """Brackets that its properties name, on a body that shoots them to memory; empty for NEF+JPEG."""
        step, program = NikonProperty.BRACKET_STEP, NikonProperty.BRACKET_PROGRAM
        needed = {step, program, NikonProperty.BRACKET_ENABLE, PropertyCode.STILL_CAPTURE_MODE}
        if (
            self._files > 1
            or not self._to_memory
            or not {*needed, PropertyCode.BURST_NUMBER} <= {*self.listed}
        ):
            return ()
        return nikon_brackets.offered(self.describe(step), self.describe(program))

    def set_auto_bracket(self, bracket: AutoBracket | None) -> None:
        """Select its bracket program in continuous shooting, in which one order takes the requested number of
        frames.
        """
        settings: tuple[tuple[int, int], ...]
        if bracket is None:
            settings = (
                (NikonProperty.BRACKET_ENABLE, 0),
                (PropertyCode.BURST_NUMBER, 1),
                (PropertyCode.STILL_CAPTURE_MODE, _SINGLE),
            )
        else:
            step, program = nikon_brackets.values(bracket)
            settings = (
                (NikonProperty.BRACKET_SET, 1),
                (NikonProperty.MANUAL_BRACKET, 0),
                (NikonProperty.BRACKET_STEP, step),
                (NikonProperty.BRACKET_PROGRAM, program),
                (PropertyCode.STILL_CAPTURE_MODE, _CONTINUOUS),
                (PropertyCode.BURST_NUMBER, bracket.frames),
                (NikonProperty.BRACKET_ENABLE, 1),
            )
        for code, wanted in settings:
            if code in self.listed and not self._stands_at(code, wanted):
                self._insist(code, wanted)

    def shoot_bracket(self, bracket: AutoBracket, seconds: float) -> Generator[Download, None, None]:
        """One order; the frames come one after the other, mostly under the same handle."""
        clock = self.session.clock
        end = clock.now() + deadline(seconds)
        self.release()
        announced, ask_at = list[int](), clock.now() + _ASK_AFTER
        for _ in range(bracket.frames):
            files = list[Download]()
            while not files:
                announced += [
                    event.parameters[0] or MEMORY_HANDLE
                    for event in self._events()
                    if event.code == NikonEvent.OBJECT_ADDED_IN_SDRAM
                ]
                if not announced and clock.now() >= ask_at:  # the event may be lost
                    announced = [MEMORY_HANDLE]
                if announced:
                    self._takes(announced.pop(0), files)
                    ask_at = clock.now() + _ASK_AFTER
                elif clock.now() >= end:
                    raise CameraTimeout(f"{self.session.where} broke its bracket off: check its menu.")
                else:
                    clock.sleep(_PAUSE)
            yield files[0]

    def fetch(self, file: Download) -> bytes:
        """Fetch from memory in one go, from a card in pieces."""
        if not _in_memory(file):
            return super().fetch(file)
        if file.data:
            return bytes(file.data)
        most = 1 << 32 if file.info.size == UNKNOWN_LENGTH else max(file.info.size, 1)
        return self.session.get(
            Operation.GET_OBJECT, file.handle, timeout=READY_TIMEOUT, most=most, prompt=PROMPT_TIMEOUT
        )

    def discard(self, file: Download) -> None:
        """Delete it from memory, else the next shot finds the camera busy."""
        if _in_memory(file) and not file.data:
            self._forget(file.handle)

    def _choose_format(self) -> None:
        description = self.describe(PropertyCode.COMPRESSION_SETTING)
        values = description.form.values if isinstance(description.form, EnumForm) else ()
        nef, now = nef_setting(values), description.current
        if nef is None or not isinstance(now, int):
            return
        if now > nef:
            self._files = 2
        else:
            self.write(PropertyCode.COMPRESSION_SETTING, nef)

    def _stands_at(self, code: int, value: int) -> bool:
        return code in self.listed and self.describe(code).current == value

    def _insist(self, code: int, wanted: int) -> None:
        """Set a property, and see that it is."""
        self.write(code, wanted)
        for _ in range(_READ_BACKS):
            if self._stands_at(code, wanted):
                return
            self.session.clock.sleep(_PAUSE)
        raise CameraRefused(f"{self.session.where} keeps its bracketing or release mode: see its dials.")

    def _takes(self, handle: int, files: list[Download]) -> bool:
        """Add an object to those of the shot; whether there was one.

        Of two in memory the first has to leave it before the second is seen: most bodies call both the same.
        """
        try:
            file = Download(handle, self.session.object_info(handle), bytearray())
            if any(one.handle == handle and not _in_memory(one) for one in files):  # announced twice
                return False
            if self._files > 1 and _in_memory(file):
                file.data[:] = self.fetch(file)
                self._forget(handle)
        except CameraRefused:
            return False
        except CameraLost:
            raise
        except CameraError:
            if has_raw(files):  # the exposure is here: a JPEG is not worth a shot
                return False
            raise
        files.append(file)
        return True

    def _forget(self, handle: int) -> None:
        with suppress(CameraRefused):  # without one
            self.session.run(Operation.DELETE_OBJECT, handle, 0, repeatable=True)

    def _change_mode(self, mode: int) -> None:
        if self.session.supports(NikonOperation.CHANGE_CAMERA_MODE):
            self.session.has_mode = True
            with passing_over(ResponseCode.CHANGE_CAMERA_MODE_FAILED):
                self.session.run(NikonOperation.CHANGE_CAMERA_MODE, mode, repeatable=True)

    def _until_ready(self, patience: float) -> None:
        if self.session.supports(NikonOperation.DEVICE_READY):
            with passing_over(ResponseCode.SILENT_RELEASE_BUSY):
                self.session.run(
                    NikonOperation.DEVICE_READY,
                    timeout=QUICK_TIMEOUT,
                    repeatable=True,
                    patience=patience,
                    prompt=_POLL_TIMEOUT,
                )

    def _events(self) -> list[Event]:
        return unpack_events(
            self.session.get(NikonOperation.GET_EVENT, timeout=QUICK_TIMEOUT, prompt=_POLL_TIMEOUT)
        )


def _in_memory(file: Download) -> bool:
    """Return whether an object lies in the camera's memory: in no folder."""
    return file.info.parent == 0

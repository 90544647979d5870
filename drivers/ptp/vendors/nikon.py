"""Nikon: remote mode, RAW into the camera's memory, DeviceReady and GetEvent by polling.

Source: libgphoto2's codes, and the property lists of a Z 6 and a D780 (its dumps). Verified
against: the simulated cameras, which follow the same notes; no hardware. Left out: bulb, in-camera
bracketing, live view, Wi-Fi pairing. A body that lists none of Nikon's operations is spoken to in plain PTP.
"""

from contextlib import suppress

from drivers.errors import CameraRefused, CameraTimeout
from drivers.ptp.codec import Event, Reader, damaged
from drivers.ptp.codes import (
    UNKNOWN_LENGTH,
    DataType,
    EventCode,
    NikonEvent,
    NikonOperation,
    NikonProperty,
    Operation,
    PropertyCode,
)
from drivers.ptp.datasets import EnumForm
from drivers.ptp.exposure import NIKON_ISO, NIKON_TIME
from drivers.ptp.session import PATIENCE, QUICK_TIMEOUT, READY_TIMEOUT, Download
from drivers.ptp.vendors.standard import StandardBody
from drivers.ptp.waiting import deadline

MEMORY_HANDLE = 0xFFFF0001
"""Where a picture lies that went to the camera's memory."""
_NEF, _TO_MEMORY, _NO_AUTOFOCUS = 0x04, 1, 0xFFFFFFFF
_PAUSE, _ASK_AFTER = 0.05, 1.0
_MEMORY_RELEASES = (
    NikonOperation.INITIATE_CAPTURE_REC_IN_MEDIA,
    NikonOperation.INITIATE_CAPTURE_REC_IN_SDRAM,
)


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

    @property
    def _to_memory(self) -> bool:
        """Whether pictures go to the camera's memory, from where they must be deleted before the next."""
        return any(self.session.supports(operation) for operation in _MEMORY_RELEASES)

    @property
    def remembers(self) -> bool:
        """Not known to, of what is in memory."""
        return not self._to_memory

    def enter(self) -> None:
        """Remote mode, memory as the destination, NEF as the format."""
        if self.session.supports(NikonOperation.GET_VENDOR_PROP_CODES):
            vendor_codes = Reader(self.session.get(NikonOperation.GET_VENDOR_PROP_CODES)).array(
                DataType.UINT16
            )
            self.listed = (*self.listed, *vendor_codes)
        super().enter()
        if self.session.supports(NikonOperation.CHANGE_CAMERA_MODE):
            self.session.run(NikonOperation.CHANGE_CAMERA_MODE, 1, repeatable=True)
        if self._to_memory and NikonProperty.RECORDING_MEDIA in self.listed:
            self.write(NikonProperty.RECORDING_MEDIA, _TO_MEMORY)
        if PropertyCode.COMPRESSION_SETTING in self.listed:
            form = self.describe(PropertyCode.COMPRESSION_SETTING).form
            if isinstance(form, EnumForm) and _NEF in form.values:
                self.write(PropertyCode.COMPRESSION_SETTING, _NEF)
        fine = self._dial(NIKON_TIME)
        if fine is not None and self.describe(fine.code).writable:
            self.time = fine  # exact, where ExposureTime counts 100 us
        self.iso = self._dial(NIKON_ISO) or self.iso

    def leave(self) -> None:
        """Local mode."""
        if self.session.supports(NikonOperation.CHANGE_CAMERA_MODE):
            self.session.run(NikonOperation.CHANGE_CAMERA_MODE, 0, repeatable=True)

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
        """Without autofocus, into the camera's memory."""
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
        """Until it is ready and has told of a picture."""
        if not (self._to_memory and self.session.supports(NikonOperation.GET_EVENT)):
            return super().wait(exposure)
        clock = self.session.clock
        end = clock.now() + deadline(exposure)
        clock.sleep(exposure)  # whoever asks meanwhile learns nothing
        self._until_ready(deadline(exposure))
        ask_at = clock.now() + _ASK_AFTER
        while clock.now() < end:
            for event in self._events():
                if event.code in (NikonEvent.OBJECT_ADDED_IN_SDRAM, EventCode.OBJECT_ADDED):
                    handle = event.parameters[0] or MEMORY_HANDLE
                    return [Download(handle, self.session.object_info(handle), bytearray())]
            if clock.now() >= ask_at:
                # The event may be lost.
                with suppress(CameraRefused):
                    return [Download(MEMORY_HANDLE, self.session.object_info(MEMORY_HANDLE), bytearray())]
                ask_at = clock.now() + _ASK_AFTER
            clock.sleep(_PAUSE)
        raise CameraTimeout(f"{self.session.where} delivered no picture: check its focus and mode dial.")

    def fetch(self, file: Download) -> bytes:
        """From memory in one go, from a card in pieces."""
        if file.handle != MEMORY_HANDLE:
            return super().fetch(file)
        most = 1 << 32 if file.info.size == UNKNOWN_LENGTH else max(file.info.size, 1)
        return self.session.get(Operation.GET_OBJECT, file.handle, timeout=READY_TIMEOUT, most=most)

    def discard(self, file: Download) -> None:
        """Delete it from memory, else the next shot finds the camera busy."""
        if file.handle == MEMORY_HANDLE:
            self._forget(file.handle)

    def _forget(self, handle: int) -> None:
        with suppress(CameraRefused):  # there is none
            self.session.run(Operation.DELETE_OBJECT, handle, 0, repeatable=True)

    def _until_ready(self, patience: float) -> None:
        if self.session.supports(NikonOperation.DEVICE_READY):
            self.session.run(
                NikonOperation.DEVICE_READY, timeout=QUICK_TIMEOUT, repeatable=True, patience=patience
            )

    def _events(self) -> list[Event]:
        return unpack_events(self.session.get(NikonOperation.GET_EVENT, timeout=QUICK_TIMEOUT))

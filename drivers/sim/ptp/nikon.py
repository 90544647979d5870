"""Nikon's way: events are asked for, and a shot may stay in the camera's memory."""

import struct

from drivers.ptp.protocol.codec import pack_array
from drivers.ptp.protocol.codes import (
    DataType,
    EventCode,
    NikonEvent,
    NikonOperation,
    NikonProperty,
    PropertyCode,
    ResponseCode,
)
from drivers.sim.ptp.operations import Handler, Phase, Reply, Request
from drivers.sim.ptp.shooting import Announcement, News
from drivers.sim.ptp.standard import Manner, always

MEMORY_HANDLE = 0xFFFF0001
DELETE_MEMORY = 0x90C3
"""DelImageSDRAM."""
_STANDARD_BELOW = 0xD000
_STEPS = (1, None, 2, 3, 6, 9)
"""Thirds of a stop by BracketStep, as a Z 6 counts them; the second is half a stop."""
_PROGRAMS = {4: 3, 5: 5, 6: 7, 7: 9}
"""Frames by BracketProgram; those to one side alone, and none at all, are left out."""
_CONTINUOUS = 2


class Nikon(Manner):
    """Capture to card or to memory, DeviceReady, GetEvent."""

    memory_handles = (MEMORY_HANDLE, MEMORY_HANDLE)
    polled = True
    _events: list[tuple[int, int]]

    def operations(self) -> dict[int, Handler]:
        """The standard's and Nikon's own."""
        return {
            **super().operations(),
            NikonOperation.CHANGE_CAMERA_MODE: Handler(lambda request: Reply()),
            NikonOperation.GET_EVENT: Handler(self._get_event, Phase.TO_HOST),
            NikonOperation.DEVICE_READY: Handler(self._ready),
            NikonOperation.GET_VENDOR_PROP_CODES: Handler(self._vendor_codes, Phase.TO_HOST),
            NikonOperation.INITIATE_CAPTURE_REC_IN_SDRAM: Handler(self._to_memory, shoots=always),
            NikonOperation.INITIATE_CAPTURE_REC_IN_MEDIA: Handler(self._to_media, shoots=always),
            DELETE_MEMORY: Handler(self._delete_memory),
        }

    def device_properties(self) -> tuple[int, ...]:
        """The standard ones; the others have to be asked for."""
        return tuple(code for code in self.properties.codes() if code < _STANDARD_BELOW)

    def begin(self) -> None:
        """Start a session with an empty history."""
        super().begin()
        self._events = []

    def announce(self, announcement: Announcement) -> None:
        """Keep it until the host asks."""
        in_memory = announcement.handle in self.memory_handles
        if announcement.news is News.OBJECT_ADDED:
            code = NikonEvent.OBJECT_ADDED_IN_SDRAM if in_memory else EventCode.OBJECT_ADDED
            self._events.append((code, announcement.handle))
        elif in_memory:
            self._events.append((NikonEvent.CAPTURE_COMPLETE_REC_IN_SDRAM, 0))
        else:
            self._events.append((EventCode.CAPTURE_COMPLETE, 0))

    def changed(self, code: int) -> None:
        """Report a changed shutter time with both its properties."""
        if code in (NikonProperty.SHUTTER_SPEED, PropertyCode.EXPOSURE_TIME):
            both = (NikonProperty.SHUTTER_SPEED, PropertyCode.EXPOSURE_TIME)
            self._events += [(EventCode.DEVICE_PROP_CHANGED, code) for code in both]

    def _get_event(self, request: Request) -> Reply:
        events, self._events = self._events, []
        packed = b"".join(struct.pack("<HI", *event) for event in events)
        return Reply(data=struct.pack("<H", len(events)) + packed)

    def _ready(self, request: Request) -> Reply:
        return Reply(ResponseCode.DEVICE_BUSY if self.shooting.shooting else ResponseCode.OK)

    def _vendor_codes(self, request: Request) -> Reply:
        vendor_codes = tuple(code for code in self.properties.codes() if code >= _STANDARD_BELOW)
        return Reply(data=pack_array(DataType.UINT16, vendor_codes))

    def _to_memory(self, request: Request) -> Reply:
        if self.fills_memory():
            return Reply(ResponseCode.DEVICE_BUSY)
        frames = _PROGRAMS.get(self._number(NikonProperty.BRACKET_PROGRAM))
        if (
            frames is None
            or not self._number(NikonProperty.BRACKET_ENABLE)
            or self._number(PropertyCode.STILL_CAPTURE_MODE) != _CONTINUOUS
        ):
            return Reply(self.shooting.shoot(request.transaction, request.faults, self.memory_handles))
        by_time = self._number(NikonProperty.BRACKET_SET) < 2 and not self._number(
            NikonProperty.MANUAL_BRACKET
        )
        thirds = _STEPS[self._number(NikonProperty.BRACKET_STEP)] if by_time else 0
        asked = self._number(PropertyCode.BURST_NUMBER)
        handles = [self.memory_handles] * min(frames, asked)
        if thirds is None:
            return Reply(ResponseCode.INVALID_PARAMETER)
        code = self.shooting.shoot_bracket(request.transaction, request.faults, thirds, handles, lambda: True)
        return Reply(code)

    def _number(self, code: int) -> int:
        description = self.properties.description(code)
        assert description is not None
        assert isinstance(description.current, int)
        return description.current

    def _to_media(self, request: Request) -> Reply:
        return self._to_memory(request) if request.parameter(1) == 1 else self._capture(request)

    def _delete_memory(self, request: Request) -> Reply:
        deleted = self.shooting.store.delete(request.parameter(0))
        return Reply(ResponseCode.OK if deleted else ResponseCode.INVALID_OBJECT_HANDLE)

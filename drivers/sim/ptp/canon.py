"""Canon EOS's way: remote mode, records that have to be asked for, a release in two halves.

Records after libgphoto2's ptp-pack.c: u32 length, u32 type, fields; an empty record of type 0 ends them.
"""

import struct

from drivers.ptp.protocol.codec import pack_array, pack_string
from drivers.ptp.protocol.codes import (
    CanonEvent,
    CanonOperation,
    CanonProperty,
    DataType,
    PropertyCode,
    ResponseCode,
)
from drivers.sim.ptp.operations import Handler, Phase, Reply, Request
from drivers.sim.ptp.shooting import Announcement, News
from drivers.sim.ptp.standard import Manner, always
from drivers.sim.ptp.store import STORAGE

MEMORY_HANDLE = 0x91910000
GET_STORAGE_IDS, GET_STORAGE_INFO, GET_OBJECT, DELETE_OBJECT = 0x9101, 0x9102, 0x9104, 0x9105
GET_DEVICE_INFO_EX, REQUEST_PROPERTY = 0x9108, 0x9127
"""Operations of Canon's own that gphoto2 uses besides those of `codes`."""
CARD, HOST = 2, 4
AEB = {0: 0, **dict(zip((0x03, 0x05, 0x08, 0x0B, 0x0D, 0x10, 0x13, 0x15, 0x18), range(1, 10), strict=True))}
"""Thirds of a stop by code."""
_DRIVE = (0, 1)
_BRACKET = 3
"""Frames, as a body shoots them that was not set to another number in its menu."""
_FULL_PRESS = 2
_U16_LIST = 3
_RAW, _JPEG = (0x10, 6, 0, 4), (0x10, 1, 0, 3)
"""Image formats, which begin with the number of files: 16 bytes, kind RAW or JPEG, size 0, compression."""
_END = struct.pack("<II", 8, 0)


def _is_full_press(request: Request) -> bool:
    return bool(request.parameter(0) & _FULL_PRESS)


class Canon(Manner):
    """Canon camera in remote mode."""

    memory_handles = (MEMORY_HANDLE, MEMORY_HANDLE + 1, *range(MEMORY_HANDLE + 2, MEMORY_HANDLE + 6))
    """One pair a frame of a bracket."""
    polled = True
    _records: list[bytes]
    _destination = CARD
    _host_room = 0
    """Bytes that the host says it has room for."""
    _aeb = _drive = 0
    _remote = False
    """True in remote mode, which ends with the session."""
    _held = False
    """True while the button is down."""

    def operations(self) -> dict[int, Handler]:
        """Canon's own; the standard's InitiateCapture is not there."""
        done = Handler(lambda request: Reply())
        every: dict[int, Handler] = {
            CanonOperation.SET_REMOTE_MODE: Handler(self._remote_mode),
            CanonOperation.SET_EVENT_MODE: Handler(self._event_mode),
            CanonOperation.KEEP_DEVICE_ON: done,
            CanonOperation.GET_EVENT: Handler(self._get_event, Phase.TO_HOST),
            CanonOperation.SET_DEVICE_PROP_VALUE_EX: Handler(self._set, Phase.TO_CAMERA),
            CanonOperation.PC_HDD_CAPACITY: Handler(self._room),
            CanonOperation.REMOTE_RELEASE: Handler(self._release, shoots=always),
            CanonOperation.REMOTE_RELEASE_ON: Handler(self._release_on, shoots=_is_full_press),
            CanonOperation.REMOTE_RELEASE_OFF: Handler(self._release_off),
            CanonOperation.GET_PARTIAL_OBJECT: Handler(self._partial, Phase.TO_HOST),
            CanonOperation.TRANSFER_COMPLETE: Handler(self._complete),
            GET_STORAGE_IDS: Handler(self._storage_ids, Phase.TO_HOST),
            GET_OBJECT: Handler(self._object, Phase.TO_HOST),
            DELETE_OBJECT: Handler(self._delete),
            GET_DEVICE_INFO_EX: Handler(self._device_info_ex, Phase.TO_HOST),
            REQUEST_PROPERTY: Handler(self._request_property),
        }
        if self.shooting.profile.records != "32":
            every[CanonOperation.GET_PARTIAL_OBJECT_64] = Handler(self._partial, Phase.TO_HOST)
        return every

    def device_properties(self) -> tuple[int, ...]:
        """Properties that the standard's operations read; the rest comes in records."""
        return (PropertyCode.BATTERY_LEVEL,)

    def begin(self) -> None:
        """No records before event mode."""
        super().begin()
        self._records, self._held, self._remote = [], False, False

    def announce(self, announcement: Announcement) -> None:
        """Queue a record of the object; the completion of the capture is not announced."""
        info = self.shooting.store.object_info(announcement.handle)
        if announcement.news is not News.OBJECT_ADDED or info is None:
            return
        self._count_shots()
        name = info.filename.encode("ascii") + b"\0"
        handle, parent = announcement.handle, info.parent
        records = self.shooting.profile.records
        if handle in self.memory_handles and records == "32":
            fields = struct.pack("<IIIII", handle, info.format, 0, info.size, 0)
            self._record(CanonEvent.REQUEST_OBJECT_TRANSFER, fields + name)
        elif handle in self.memory_handles and records == "64":
            fields = struct.pack("<IIIQ", handle, info.format, 0, info.size)
            self._record(CanonEvent.REQUEST_OBJECT_TRANSFER_64, fields + name)
        elif handle in self.memory_handles:  # without a name: an empty string, then the folder
            fields = struct.pack("<IIIQBII", handle, info.format, 0, info.size, 0, parent, 6)
            self._record(CanonEvent.REQUEST_OBJECT_TRANSFER_64_LONG_NAME, fields)
        elif records == "32":
            head = struct.pack("<IIIII", handle, STORAGE, info.format, 0, 0)
            fields = head + struct.pack("<III", info.size, parent, handle)
            self._record(CanonEvent.OBJECT_ADDED_EX, fields + name)
        else:
            head = struct.pack("<IIIII", handle, STORAGE, info.format, 0, 0)
            fields = head + struct.pack("<QII", info.size, parent, handle)
            if records == "64":
                self._record(CanonEvent.OBJECT_ADDED_EX_64, fields + name)
            else:  # a date, then the name as a string of PTP
                moment = struct.pack("<I", 0x66000000)
                self._record(
                    CanonEvent.OBJECT_ADDED_EX_64_LONG_NAME, fields + moment + pack_string(info.filename)
                )

    def changed(self, code: int) -> None:
        """A record of the value."""
        dial = self.shooting.dials.get(code)
        if dial is not None:
            self._value(code, self.shooting.shown(dial))

    def _record(self, kind: int, fields: bytes) -> None:
        fields += bytes(-len(fields) % 4)
        self._records.append(struct.pack("<II", 8 + len(fields), kind) + fields)

    def _value(self, code: int, *values: int) -> None:
        self._record(CanonEvent.PROP_VALUE_CHANGED, struct.pack(f"<{1 + len(values)}I", code, *values))

    def _list(self, code: int, values: tuple[int, ...]) -> None:
        fields = struct.pack(f"<{3 + len(values)}I", code, _U16_LIST, len(values), *values)
        self._record(CanonEvent.AVAILABLE_LIST_CHANGED, fields)

    def _remote_mode(self, request: Request) -> Reply:
        self._remote = request.parameter(0) != 0
        return Reply()

    def _event_mode(self, request: Request) -> Reply:
        """Start the records; the first ones hold all values."""
        self._records = []
        for code, dial in self.shooting.dials.items():
            self._value(code, self.shooting.shown(dial))
            self._list(code, dial.numbers())
        self._count_shots()
        self._value(CanonProperty.CAPTURE_DESTINATION, self._destination)
        self._list(CanonProperty.CAPTURE_DESTINATION, (CARD, HOST))
        both = self.shooting.quality in self.shooting.profile.raw_jpeg_settings
        self._value(CanonProperty.IMAGE_FORMAT, *((2, *_RAW, *_JPEG) if both else (1, *_RAW)))
        self._value(CanonProperty.AEB, self._aeb)
        self._list(CanonProperty.AEB, tuple(AEB))
        self._value(CanonProperty.DRIVE_MODE, self._drive)
        self._list(CanonProperty.DRIVE_MODE, _DRIVE)
        return Reply()

    def _get_event(self, request: Request) -> Reply:
        records, self._records = self._records, []
        return Reply(data=b"".join(records) + _END)

    def _set(self, request: Request) -> Reply:
        """Data: u32 length of all, u32 property, the value."""
        if not self._remote:
            return Reply(ResponseCode.ACCESS_DENIED)
        if len(request.data) < 12:
            return Reply(ResponseCode.INVALID_PARAMETER)
        _, code, value = struct.unpack_from("<III", request.data)
        if code == CanonProperty.CAPTURE_DESTINATION and value in (CARD, HOST):
            self._destination = value
            self._value(code, value)
            self._count_shots()
            return Reply()
        if (code == CanonProperty.AEB and value in AEB) or (
            code == CanonProperty.DRIVE_MODE and value in _DRIVE
        ):
            if code == CanonProperty.AEB:
                self._aeb = value
            else:
                self._drive = value
            self._value(code, value)
            return Reply()
        dial = self.shooting.dials.get(code)
        if dial is None:
            return Reply(ResponseCode.DEVICE_PROP_NOT_SUPPORTED)
        if self.shooting.shooting:
            return Reply(ResponseCode.DEVICE_BUSY)
        if not self.shooting.turn(dial, value & 0xFFFF):
            return Reply(ResponseCode.INVALID_DEVICE_PROP_VALUE)
        self.changed(code)
        return Reply()

    def _room(self, request: Request) -> Reply:
        self._host_room = request.parameter(0) * request.parameter(1)
        self._count_shots()
        return Reply()

    def _count_shots(self) -> None:
        """Report the number of pictures that fit; hosts wait for that before they shoot to themselves."""
        store = self.shooting.store
        self._value(
            CanonProperty.AVAILABLE_SHOTS, store.pictures(self._host_room if self._to_host else store.free)
        )

    @property
    def _to_host(self) -> bool:
        return self._destination == HOST

    def _release_on(self, request: Request) -> Reply:
        self._held |= _is_full_press(request)
        return self._release(request) if _is_full_press(request) else Reply(parameters=(0,))

    def _release_off(self, request: Request) -> Reply:
        self._held &= not _is_full_press(request)
        return Reply()

    def _release(self, request: Request) -> Reply:
        if not self._remote:
            return Reply(ResponseCode.ACCESS_DENIED)
        if self._to_host and not self._host_room:
            return Reply(ResponseCode.STORE_FULL)
        if self.fills_memory():
            return Reply(ResponseCode.DEVICE_BUSY)
        memory = (MEMORY_HANDLE, MEMORY_HANDLE + 1) if self._to_host else None
        if self._aeb and self._drive and self._to_host:
            handles = self.memory_handles
            pairs = list(zip(handles[::2], handles[1::2], strict=True))[:_BRACKET]
            thirds = AEB[self._aeb]
            code = self.shooting.shoot_bracket(
                request.transaction, request.faults, thirds, pairs, lambda: self._held
            )
            return Reply(code, (0,))
        return Reply(self.shooting.shoot(request.transaction, request.faults, memory), (0,))

    def _object(self, request: Request) -> Reply:
        data = self.shooting.store.data(request.parameter(0))
        return Reply(ResponseCode.INVALID_OBJECT_HANDLE) if data is None else Reply(data=data)

    def _partial(self, request: Request) -> Reply:
        handle, at, most = (request.parameter(index) for index in range(3))
        data = self.shooting.store.data(handle)
        if data is None:
            return Reply(ResponseCode.INVALID_OBJECT_HANDLE)
        return Reply(data=data[at : at + most])

    def _complete(self, request: Request) -> Reply:
        """The host has all of an object; one in memory goes, and the next shot may come."""
        if request.parameter(0) in self.memory_handles:
            self.shooting.store.delete(request.parameter(0))
        return Reply()

    def _delete(self, request: Request) -> Reply:
        deleted = self.shooting.store.delete(request.parameter(0))
        return Reply(ResponseCode.OK if deleted else ResponseCode.INVALID_OBJECT_HANDLE)

    def _storage_ids(self, request: Request) -> Reply:
        return Reply(data=pack_array(DataType.UINT32, (STORAGE,)))

    def _device_info_ex(self, request: Request) -> Reply:
        events = pack_array(DataType.UINT32, tuple(CanonEvent))
        makers = (
            CanonProperty.AVAILABLE_SHOTS,
            CanonProperty.CAPTURE_DESTINATION,
            CanonProperty.IMAGE_FORMAT,
        )
        codes = (*self.shooting.dials, *makers)
        lists = events + pack_array(DataType.UINT32, codes) + pack_array(DataType.UINT32, ())
        return Reply(data=struct.pack("<I", 4 + len(lists)) + lists)

    def _request_property(self, request: Request) -> Reply:
        self.changed(request.parameter(0))
        return Reply()

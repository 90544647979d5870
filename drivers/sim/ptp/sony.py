"""Sony's way: a handshake, one blob with all properties, buttons to press, the shot waiting in memory."""

import struct

from drivers.ptp.protocol.codec import Event, pack_array, pack_value, unpack_value
from drivers.ptp.protocol.codes import (
    DataType,
    Operation,
    PropertyCode,
    ResponseCode,
    SonyEvent,
    SonyOperation,
    SonyProperty,
)
from drivers.ptp.protocol.datasets import DevicePropDesc, EnumForm, RangeForm
from drivers.sim.ptp.operations import Handler, Phase, Reply, Request
from drivers.sim.ptp.properties import SONY_BRACKETS
from drivers.sim.ptp.shooting import Announcement, News
from drivers.sim.ptp.standard import Manner

MEMORY_HANDLE = 0xFFFFC001
_PROTOCOL = 0x00C8
_OBJECT_READY = 0x8000
_PRESSED = b"\2\0"
_BUTTONS = (SonyProperty.HALF_PRESS, SonyProperty.FULL_PRESS)
_ENABLED = 1


def _is_full_press(request: Request) -> bool:
    return request.parameter(0) == SonyProperty.FULL_PRESS and request.data == _PRESSED


class Sony(Manner):
    """SDIO_Connect, GetAllExtDevicePropInfo, the shutter button."""

    memory_handles = (MEMORY_HANDLE, MEMORY_HANDLE)
    _connected = 0
    _held = False
    """True while the button is down."""

    def operations(self) -> dict[int, Handler]:
        """Sony's own; neither the standard's capture nor its way of setting properties works."""
        return {
            SonyOperation.SDIO_CONNECT: Handler(self._connect, Phase.TO_HOST),
            SonyOperation.GET_EXT_DEVICE_INFO: Handler(self._ext_device_info, Phase.TO_HOST),
            SonyOperation.SET_CONTROL_A: Handler(self._set, Phase.TO_CAMERA),
            SonyOperation.SET_CONTROL_B: Handler(self._press, Phase.TO_CAMERA, shoots=_is_full_press),
            SonyOperation.GET_ALL_EXT_DEVICE_PROP_INFO: Handler(self._everything, Phase.TO_HOST),
            Operation.SET_DEVICE_PROP_VALUE: Handler(self._refuse, Phase.TO_CAMERA),
        }

    def device_properties(self) -> tuple[int, ...]:
        """None that DeviceInfo names: GetExtDeviceInfo does."""
        return ()

    def begin(self) -> None:
        """The handshake has to be done again."""
        super().begin()
        self._connected, self._held = 0, False

    def announce(self, announcement: Announcement) -> None:
        """An event for the object; the property that says the same does not depend on it."""
        if announcement.news is News.OBJECT_ADDED:
            self.tell(Event(SonyEvent.OBJECT_ADDED, 0, (announcement.handle,)))

    def changed(self, code: int) -> None:
        """The blob shows it."""

    def fetched(self, handle: int) -> None:
        """Reading frees the memory."""
        if handle == MEMORY_HANDLE:
            self.shooting.store.delete(handle)

    def _connect(self, request: Request) -> Reply:
        self._connected = max(self._connected, request.parameter(0))
        return Reply(data=bytes(8))

    def _ext_device_info(self, request: Request) -> Reply:
        if self._connected < 2:
            return Reply(ResponseCode.ACCESS_DENIED)
        settings = pack_array(DataType.UINT16, self.properties.codes())
        return Reply(data=struct.pack("<H", _PROTOCOL) + settings + pack_array(DataType.UINT16, _BUTTONS))

    def _everything(self, request: Request) -> Reply:
        if self._connected < 3:
            return Reply(ResponseCode.ACCESS_DENIED)
        ready = self.shooting.store.count(MEMORY_HANDLE)
        self.properties.put(SonyProperty.OBJECT_IN_MEMORY, _OBJECT_READY + ready if ready else 0)
        descriptions = [self.properties.description(code) for code in self.properties.codes()]
        entries = [_entry(description) for description in descriptions if description is not None]
        return Reply(data=struct.pack("<II", len(entries), 0) + b"".join(entries))

    def _set(self, request: Request) -> Reply:
        if self._connected < 3:
            return Reply(ResponseCode.ACCESS_DENIED)
        result = self.properties.set(request.parameter(0), request.data)
        # What is not on the list changes nothing and is no error: only reading back shows it. gphoto2
        # relies on that, when it sends a 0 after it has turned the shutter by steps.
        ignored = result == ResponseCode.INVALID_DEVICE_PROP_VALUE
        return Reply(ResponseCode.OK if ignored else result)

    def _press(self, request: Request) -> Reply:
        button = request.parameter(0)
        if self._connected >= 3 and button in self.shooting.dials and len(request.data) == 1:
            return self._step(button, request.data)
        if self._connected < 3 or button not in _BUTTONS or len(request.data) != 2:
            return Reply(ResponseCode.INVALID_PARAMETER)
        if button == SonyProperty.FULL_PRESS:
            self._held = _is_full_press(request)
        if not _is_full_press(request):
            return Reply()
        if self.fills_memory():
            return Reply(ResponseCode.DEVICE_BUSY)
        mode = self.properties.description(PropertyCode.STILL_CAPTURE_MODE)
        bracket = SONY_BRACKETS.get(mode.current) if mode and isinstance(mode.current, int) else None
        if bracket is not None:
            thirds, frames = bracket
            code = self.shooting.shoot_bracket(
                request.transaction,
                request.faults,
                thirds,
                [self.memory_handles] * frames,
                lambda: self._held,
            )
            return Reply(code)
        return Reply(self.shooting.shoot(request.transaction, request.faults, self.memory_handles))

    def _step(self, code: int, data: bytes) -> Reply:
        """Turn a dial by steps: on is shorter for the shutter, more for the others; it stops at its ends."""
        if self.shooting.shooting:
            return Reply(ResponseCode.DEVICE_BUSY)
        dial = self.shooting.dials[code]
        numbers = dial.numbers()
        steps = unpack_value(DataType.INT8, data)
        assert isinstance(steps, int)
        at = numbers.index(self.shooting.shown(dial)) + (-steps if dial.setting == "time" else steps)
        self.shooting.turn(dial, numbers[min(max(at, 0), len(numbers) - 1)])
        return Reply()

    def _refuse(self, request: Request) -> Reply:
        return Reply(ResponseCode.ACCESS_DENIED)


def _entry(description: DevicePropDesc) -> bytes:
    """A descriptor in the blob: the standard's, with a byte more that says whether it can be set now."""
    kind = description.data_type
    head = struct.pack(
        "<HHBB", description.code, kind, description.writable, _ENABLED if description.writable else 2
    )
    values = pack_value(kind, description.default) + pack_value(kind, description.current)
    match description.form:
        case RangeForm(minimum, maximum, step):
            form = b"\1" + b"".join(pack_value(kind, value) for value in (minimum, maximum, step))
        case EnumForm(choices):
            packed = b"".join(pack_value(kind, value) for value in choices)
            form = b"\2" + struct.pack("<H", len(choices)) + packed
        case None:
            form = b"\0"
    return head + values + form

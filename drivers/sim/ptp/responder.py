"""A PTP responder: operations in, data and responses out, whatever carries them.

`ptp_usb` puts it on the virtual bus, `ptpip` on a socket. How the makers' own operations go is in
`ptp_canon`, `ptp_nikon` and `ptp_sony`, each a `Manner`.
"""

from collections.abc import Callable

from drivers.ptp.protocol.codec import Event, pack_array, pack_value
from drivers.ptp.protocol.codes import DataType, EventCode, NikonOperation, Operation, ResponseCode
from drivers.ptp.protocol.datasets import DeviceInfo
from drivers.sim.camera.camera import SimulatedCamera
from drivers.sim.faults import CAPTURE_FAULTS, Fault, FaultPlan, Kind
from drivers.sim.ptp.canon import Canon
from drivers.sim.ptp.nikon import Nikon
from drivers.sim.ptp.operations import Handler, Phase, Reply, Request, operation_name
from drivers.sim.ptp.profiles import CameraProfile, Style
from drivers.sim.ptp.properties import SimulatedProperties
from drivers.sim.ptp.shooting import Shooting
from drivers.sim.ptp.sony import Sony
from drivers.sim.ptp.standard import Manner
from drivers.sim.ptp.store import STORAGE
from drivers.sim.usb.timeline import Timeline

_MANNERS: dict[Style, type[Manner]] = {
    Style.STANDARD: Manner,
    Style.CANON: Canon,
    Style.NIKON: Nikon,
    Style.SONY: Sony,
}
_WITHOUT_SESSION = (Operation.GET_DEVICE_INFO, Operation.OPEN_SESSION)
_NEVER_BUSY = (*_WITHOUT_SESSION, Operation.CLOSE_SESSION)
_EVERY_STORAGE = (0, STORAGE, 0xFFFFFFFF)
_NO_SUCH = Reply(ResponseCode.INVALID_OBJECT_HANDLE)


class Responder:
    """One simulated camera as PTP sees it; `handle` takes the timeline's lock."""

    def __init__(
        self,
        camera: SimulatedCamera,
        profile: CameraProfile,
        timeline: Timeline,
        plan: FaultPlan | None = None,
    ) -> None:
        self.profile, self.timeline = profile, timeline
        self.plan = plan or FaultPlan(timeline)
        self.serial = camera.body.serial
        self.listener: Callable[[Event], None] | None = None
        """Carrier of events to the host."""
        self.shooting = Shooting(
            camera, profile, timeline, lambda announcement: self._manner.announce(announcement)
        )
        self.properties = SimulatedProperties(self.shooting)
        self._manner = _MANNERS[profile.style](self.shooting, self.properties, self._tell)
        self._in_session = False
        self._busy_until, self._busy_times, self._bulb_until = 0.0, 0, 0.0
        self._handlers: dict[int, Handler] = {**self._standard(), **self._manner.operations()}

    def takes_data(self, operation: int) -> bool:
        """Return whether the host sends data with it."""
        handler = self._handlers.get(operation)
        return handler is not None and handler.phase is Phase.TO_CAMERA

    def faults(self, request: Request, carrier: frozenset[Kind]) -> tuple[Fault, ...]:
        """Planned faults of an operation that comes now; `carrier`: faults that the carrier can show."""
        operation = request.operation
        handler = self._handlers.get(operation)
        if handler is None or self._is_busy():
            return ()
        able = carrier if handler.phase is Phase.TO_HOST else carrier - _OF_DATA
        if operation not in _NEVER_BUSY:
            able |= {Kind.BUSY}
        if operation == NikonOperation.DEVICE_READY:
            able |= {Kind.BULB}
        if handler.shoots(request):
            able |= CAPTURE_FAULTS - ({Kind.LOST_EVENT} if self._manner.polled else set())
        return self.plan.strike(self.serial, operation_name(operation, self.profile.style), able)

    def handle(self, request: Request) -> Reply:
        """Run an operation."""
        with self.timeline.lock:
            return self._reply(request)

    def reset(self) -> None:
        """The host reset the device, or went away: the session is over; a shot under way goes on."""
        self._in_session = False

    def _reply(self, request: Request) -> Reply:
        handler = self._handlers.get(request.operation)
        if handler is None:
            return Reply(ResponseCode.OPERATION_NOT_SUPPORTED)
        if not self._in_session and request.operation not in _WITHOUT_SESSION:
            return Reply(ResponseCode.SESSION_NOT_OPEN)
        for fault in request.faults:
            if fault.kind is Kind.BULB:
                self._bulb_until = self.timeline.now() + fault.seconds
            if fault.kind is Kind.BUSY:
                self._busy_until = self.timeline.now() + fault.seconds
                self._busy_times = fault.count
        if request.operation not in _NEVER_BUSY and self._is_busy():
            self._busy_times = max(0, self._busy_times - 1)
            return Reply(ResponseCode.DEVICE_BUSY)
        if request.operation == NikonOperation.DEVICE_READY and self.timeline.now() < self._bulb_until:
            return Reply(ResponseCode.BULB_RELEASE_BUSY)
        return handler.act(request)

    def _is_busy(self) -> bool:
        return self._busy_times > 0 or self.timeline.now() < self._busy_until

    def _tell(self, event: Event) -> None:
        if self._in_session and self.listener is not None:
            self.listener(event)

    def _standard(self) -> dict[int, Handler]:
        to_host, to_camera = Phase.TO_HOST, Phase.TO_CAMERA
        return {
            Operation.GET_DEVICE_INFO: Handler(self._device_info, to_host),
            Operation.OPEN_SESSION: Handler(self._open),
            Operation.CLOSE_SESSION: Handler(self._close),
            Operation.GET_STORAGE_IDS: Handler(self._storage_ids, to_host),
            Operation.GET_STORAGE_INFO: Handler(self._storage_info, to_host),
            Operation.GET_NUM_OBJECTS: Handler(self._count_objects),
            Operation.GET_OBJECT_HANDLES: Handler(self._object_handles, to_host),
            Operation.GET_OBJECT_INFO: Handler(self._object_info, to_host),
            Operation.GET_OBJECT: Handler(self._object, to_host),
            Operation.GET_PARTIAL_OBJECT: Handler(self._partial_object, to_host),
            Operation.DELETE_OBJECT: Handler(self._delete),
            Operation.GET_DEVICE_PROP_DESC: Handler(self._describe, to_host),
            Operation.GET_DEVICE_PROP_VALUE: Handler(self._value, to_host),
            Operation.SET_DEVICE_PROP_VALUE: Handler(self._set_value, to_camera),
        }

    def _device_info(self, request: Request) -> Reply:
        profile = self.profile
        events = (
            EventCode.OBJECT_ADDED,
            EventCode.DEVICE_PROP_CHANGED,
            EventCode.STORE_FULL,
            EventCode.CAPTURE_COMPLETE,
        )
        info = DeviceInfo(
            vendor_extension=profile.extension,
            vendor_version=profile.extension_version,
            vendor_description=profile.extension_text,
            operations=tuple(sorted(self._handlers)),
            events=(*events, *profile.events),
            properties=self._manner.device_properties(),
            capture_formats=(profile.raw_format,),
            image_formats=(0x3001, 0x3801, profile.raw_format),
            manufacturer=profile.maker,
            model=profile.model,
            device_version="1.0",
            serial=self.serial,
        )
        return Reply(data=info.pack())

    def _open(self, request: Request) -> Reply:
        if self._in_session:
            return Reply(ResponseCode.SESSION_ALREADY_OPENED)
        if request.parameter(0) == 0:
            return Reply(ResponseCode.INVALID_PARAMETER)
        self._in_session = True
        self._manner.begin()
        return Reply()

    def _close(self, request: Request) -> Reply:
        self._in_session = False
        return Reply()

    def _storage_ids(self, request: Request) -> Reply:
        return Reply(data=pack_array(DataType.UINT32, (STORAGE,)))

    def _storage_info(self, request: Request) -> Reply:
        if request.parameter(0) != STORAGE:
            return Reply(ResponseCode.INVALID_STORAGE_ID)
        return Reply(data=self.shooting.store.info().pack())

    def _listed(self, request: Request) -> tuple[int, ...] | None:
        if request.parameter(0) not in _EVERY_STORAGE:
            return None
        return self.shooting.store.handles(request.parameter(1), request.parameter(2))

    def _count_objects(self, request: Request) -> Reply:
        listed = self._listed(request)
        if listed is None:
            return Reply(ResponseCode.INVALID_STORAGE_ID)
        return Reply(parameters=(len(listed),))

    def _object_handles(self, request: Request) -> Reply:
        listed = self._listed(request)
        if listed is None:
            return Reply(ResponseCode.INVALID_STORAGE_ID)
        return Reply(data=pack_array(DataType.UINT32, listed))

    def _object_info(self, request: Request) -> Reply:
        info = self.shooting.store.object_info(request.parameter(0))
        return _NO_SUCH if info is None else Reply(data=info.pack())

    def _object(self, request: Request) -> Reply:
        handle = request.parameter(0)
        data = self.shooting.store.data(handle)
        if data is None:
            return _NO_SUCH
        self._manner.fetched(handle)
        return Reply(data=data)

    def _partial_object(self, request: Request) -> Reply:
        handle, at, most = (request.parameter(index) for index in range(3))
        data = self.shooting.store.data(handle)
        if data is None:
            return _NO_SUCH
        part = data[at : at + most]
        return Reply(parameters=(len(part),), data=part)

    def _delete(self, request: Request) -> Reply:
        return Reply() if self.shooting.store.delete(request.parameter(0)) else _NO_SUCH

    def _describe(self, request: Request) -> Reply:
        description = self.properties.description(request.parameter(0))
        return (
            Reply(ResponseCode.DEVICE_PROP_NOT_SUPPORTED)
            if description is None
            else Reply(data=description.pack())
        )

    def _value(self, request: Request) -> Reply:
        description = self.properties.description(request.parameter(0))
        if description is None:
            return Reply(ResponseCode.DEVICE_PROP_NOT_SUPPORTED)
        return Reply(data=pack_value(description.data_type, description.current))

    def _set_value(self, request: Request) -> Reply:
        code = request.parameter(0)
        result = self.properties.set(code, request.data)
        if result == ResponseCode.OK:
            self._manner.changed(code)
        return Reply(result)


_OF_DATA = frozenset({Kind.NO_RESPONSE, Kind.TRUNCATED, Kind.SPLIT_HEADER, Kind.MERGED_RESPONSE})
"""Faults that only data towards the host can have."""

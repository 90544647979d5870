"""A host of few words for simulated PTP cameras on the virtual bus."""

from collections.abc import Callable, Iterator

import pytest

from drivers.errors import CameraTimeout
from drivers.ptp.protocol.codec import Command, Data, Event, Header, Response, pack_value, parse
from drivers.ptp.protocol.codes import (
    DataType,
    EventCode,
    Operation,
    ResponseCode,
)
from drivers.sim.camera.camera import SimulatedCamera
from drivers.sim.faults import Fault, FaultPlan
from drivers.sim.ptp.profiles import profile
from drivers.sim.ptp.responder import Responder
from drivers.sim.ptp.usb_device import PtpDevice
from drivers.sim.rigs import SimulatedRig, simulate
from drivers.sim.usb.bus import VirtualBus
from drivers.sim.usb.timeline import LiveTimeline
from drivers.sim.usb.virtual_clock import VirtualClock
from drivers.usb import STILL_IMAGE, find

OK = ResponseCode.OK


class Host:
    """A PTP initiator of few words: one transaction after the other, no recovery."""

    def __init__(self, rig: SimulatedRig, name: str, faults: tuple[Fault, ...]) -> None:
        self.rig = rig
        self.clock = VirtualClock()
        self.bus = VirtualBus(self.clock)
        self.plan = FaultPlan(self.clock, faults)
        camera = SimulatedCamera(rig.bodies[0], lambda frame: rig.radiance(0, frame))
        self.responder = Responder(camera, profile(name), self.clock, self.plan)
        self.bus.plug(PtpDevice(self.responder))
        self.surplus = b""
        self.connect()

    def connect(self) -> None:
        self.pipe = find(STILL_IMAGE, self.bus)[0].open()
        self.incoming = self.pipe.endpoint(into_host=True)
        self.transaction = 0
        assert self.run(Operation.OPEN_SESSION, 1).code == OK

    def read(self, timeout: float = 1.0) -> bytes:
        data = self.surplus or self.pipe.read(self.incoming, 1 << 20, timeout)
        self.surplus = b""
        length = Header.unpack(data).length
        while len(data) < length:
            piece = self.pipe.read(self.incoming, 1 << 20, timeout)
            assert piece
            data += piece
        self.surplus = data[length:]
        return data[:length]

    def run(self, operation: int, *parameters: int, data: bytes | None = None) -> Response:
        """The response; `self.data` is what came before it."""
        command = Command(operation, self.transaction, parameters)
        self.transaction += 1
        out = self.pipe.endpoint(into_host=False)
        self.pipe.write(out, command.pack(), 1.0)
        if data is not None:
            self.pipe.write(out, Data(operation, command.transaction, data).pack(), 1.0)
        self.data = b""
        answer = parse(self.read())
        if isinstance(answer, Data):
            self.data = answer.payload
            answer = parse(self.read())
        assert isinstance(answer, Response)
        assert answer.transaction == command.transaction
        return answer

    def get(self, operation: int, *parameters: int) -> bytes:
        assert self.run(operation, *parameters).code == OK
        return self.data

    def events(self, seconds: float) -> list[Event]:
        """Collect events until nothing has come for that long."""
        events, endpoint = [], self.pipe.endpoint(into_host=True, interrupt=True)
        while True:
            try:
                events.append(Event.unpack(self.pipe.read(endpoint, 32, seconds)))
            except CameraTimeout:
                return events

    def set(self, code: int, kind: DataType, value: int) -> int:
        return self.run(Operation.SET_DEVICE_PROP_VALUE, code, data=pack_value(kind, value)).code

    def shoot(self) -> int:
        """A shot of the standard's kind; the handle of its file."""
        assert self.run(Operation.INITIATE_CAPTURE, 0, 0).code == OK
        added = [event for event in self.events(5.0) if event.code == EventCode.OBJECT_ADDED]
        assert len(added) == 1
        return added[0].parameters[0]


@pytest.fixture(scope="session")
def toys() -> dict[str, SimulatedRig]:
    return {name: simulate(name) for name in ("toy", "toy-ldr")}


@pytest.fixture
def timeline() -> Iterator[LiveTimeline]:
    timeline = LiveTimeline()
    yield timeline
    timeline.close()


@pytest.fixture
def plug(toys: dict[str, SimulatedRig]) -> Callable[..., Host]:
    """Plugs in the first camera of a rig, as a model and with faults, and opens a session with it."""
    return lambda name="generic", *faults, rig="toy": Host(toys[rig], name, faults)

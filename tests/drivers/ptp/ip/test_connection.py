"""Connection to a camera at an address, pairing, and reconnection after a break."""

import struct
import threading
from pathlib import Path

import pytest

from drivers.camera import CameraFile
from drivers.clock import SystemClock
from drivers.errors import (
    CameraClaimed,
    CameraGone,
    CameraLost,
    CameraNotFound,
    CameraPermission,
    CameraProtocol,
    CameraRefused,
    CameraTimeout,
)
from drivers.ptp import PtpCamera, cameras_at
from drivers.ptp.ip import connection
from drivers.ptp.ip.connection import connect, own_guid, own_name
from drivers.ptp.ip.packets import PacketType
from drivers.ptp.protocol import session
from drivers.ptp.vendors.standard import StandardBody
from drivers.sim.camera.camera import SimulatedCamera
from drivers.sim.faults import Fault, FaultPlan, Kind
from drivers.sim.ptp.profiles import PROFILES, profile
from drivers.sim.ptp.ptpip import PtpIpServer, listen
from drivers.sim.ptp.responder import Responder
from drivers.sim.rigs import SimulatedRig, simulate
from drivers.sim.usb.timeline import LiveTimeline
from imaging.optics.exposure import Exposure

from .peers import packet, peer

CLOCK = SystemClock()
WANTED = Exposure(time=1 / 250, f_number=4.0, iso=400.0)


@pytest.fixture(scope="module")
def rig() -> SimulatedRig:
    rig = simulate("toy")
    rig.radiance(0, 0)
    return rig


def test_cameras_know_this_computer_again() -> None:
    with peer() as there:
        for _ in range(2):
            connect(there.host, there.port, CLOCK).close()
        asked = [fields for _, kind, fields in there.received if kind == PacketType.INIT_COMMAND_REQUEST]
    name = own_name().encode("utf-16-le") + b"\0\0"
    assert asked == [own_guid() + name + b"\0\0\1\0"] * 2
    assert len(own_guid()) == 16
    assert own_name().startswith("rig on ")
    assert len(own_name()) <= 39
    numbers = [fields for _, kind, fields in there.received if kind == PacketType.INIT_EVENT_REQUEST]
    assert numbers == [struct.pack("<I", 7)] * 2


@pytest.mark.parametrize(
    ("init", "error", "says"),
    [
        (packet(5, struct.pack("<I", 1)), CameraPermission, "turns this computer away: pair the camera"),
        (packet(5, struct.pack("<I", 2)), CameraClaimed, "is connected to another program or device"),
        (packet(5, struct.pack("<I", 3)), CameraRefused, r"accepts no connection \(reason 3\)"),
        (packet(2, bytes(12)), CameraProtocol, "an acknowledgement of 12 bytes"),
        (packet(9), CameraProtocol, "a packet of type 9 instead of an accepted connection"),
        (b"HTTP/1.0 400 Bad Request", CameraProtocol, "a packet of 1347703880 bytes"),
    ],
)
@pytest.mark.parametrize("events", [False, True])
def test_a_camera_that_accepts_no_connection_says_why(
    init: bytes, error: type[Exception], says: str, *, events: bool
) -> None:
    with peer() as there:
        if events and "acknowledgement" not in says:
            there.init_events = init
        else:
            there.init = init
        with pytest.raises(error, match=says):
            connect(there.host, there.port, CLOCK)


def test_nobody_there_and_nobody_who_says_yes() -> None:
    with peer() as there:
        there.init = b""
        with pytest.raises(CameraTimeout, match="confirm it on the camera, where this computer is called"):
            connect(there.host, there.port, CLOCK, patience=0.05)
        port = there.port
    with pytest.raises(CameraNotFound, match=r"cannot be reached \(connection refused\)"):
        connect("127.0.0.1", port, CLOCK)


def shot(camera: PtpCamera) -> CameraFile:
    assert camera.set_exposure(WANTED) == WANTED
    camera.arm()
    camera.trigger()
    return camera.collect()


def served(
    rig: SimulatedRig, timeline: LiveTimeline, name: str, *faults: Fault
) -> tuple[PtpIpServer, FaultPlan]:
    plan = FaultPlan(timeline, faults)
    camera = SimulatedCamera(rig.bodies[0], lambda frame: rig.radiance(0, frame))
    return PtpIpServer(Responder(camera, profile(name), timeline, plan), listen(port=0)), plan


@pytest.mark.parametrize("name", sorted(PROFILES))
def test_every_make_shoots_and_its_connection_may_break_in_between(
    rig: SimulatedRig, timeline: LiveTimeline, name: str
) -> None:
    server, _ = served(rig, timeline, name)
    with server:
        (camera,) = cameras_at([(server.host, server.port)], CLOCK)
        assert camera.identify().serial == "SIM-RAW-001"
        first = shot(camera)
        assert first.metadata.exposure == WANTED
        assert camera._body is not None
        camera._body.session.transport.close()
        assert shot(camera).metadata.exposure == WANTED
        camera.close()
        camera.close()


@pytest.mark.parametrize(
    ("operation", "kind"),
    [
        ("GET_PARTIAL_OBJECT", Kind.UNPLUG),
        ("GET_PARTIAL_OBJECT", Kind.TRUNCATED),
        ("GET_PARTIAL_OBJECT", Kind.WRONG_TRANSACTION),
        ("GET_OBJECT_INFO", Kind.TIMEOUT),
        ("GET_DEVICE_PROP_DESC", Kind.UNPLUG),
        ("SET_DEVICE_PROP_VALUE", Kind.TIMEOUT),
        ("OPEN_SESSION", Kind.UNPLUG),
    ],
)
def test_a_shot_is_whole_whatever_breaks_on_its_way(
    rig: SimulatedRig, timeline: LiveTimeline, monkeypatch: pytest.MonkeyPatch, operation: str, kind: Kind
) -> None:
    monkeypatch.setattr(session, "PROMPT_TIMEOUT", 0.1)
    monkeypatch.setattr(connection, "_LOOK_EVERY", 0.01)
    server, plan = served(rig, timeline, "generic", Fault(kind, operation=operation, count=100))
    with server:
        (camera,) = cameras_at([(server.host, server.port)], CLOCK)
        taken = shot(camera)
        camera.close()
    assert [happened.fault.kind for happened in plan.log] == [kind]
    assert taken.metadata.exposure == WANTED
    clean, _ = served(rig, timeline, "generic")
    with clean:
        (camera,) = cameras_at([(clean.host, clean.port)], CLOCK)
        assert shot(camera).data == taken.data
        camera.close()


def test_a_trigger_is_never_given_twice(rig: SimulatedRig, timeline: LiveTimeline) -> None:
    server, _ = served(rig, timeline, "generic", Fault(Kind.UNPLUG, operation="INITIATE_CAPTURE"))
    with server:
        (camera,) = cameras_at([(server.host, server.port)], CLOCK)
        camera.set_exposure(WANTED)
        camera.arm()
        with pytest.raises(CameraLost):
            camera.trigger()
        assert server._responder.plan._counts["SIM-RAW-001", "INITIATE_CAPTURE"] == 1
        camera.arm()
        camera.trigger()
        assert camera.collect().metadata.exposure == WANTED
        camera.close()


def test_another_camera_at_the_address_is_not_taken_for_it(
    rig: SimulatedRig, timeline: LiveTimeline, monkeypatch: pytest.MonkeyPatch
) -> None:
    server, _ = served(rig, timeline, "generic")
    with server:
        (camera,) = cameras_at([(server.host, server.port)], CLOCK)
        camera.identify()
        camera.close()
        server._responder.serial = "ANOTHER"
        with pytest.raises(CameraRefused, match="is camera ANOTHER now, not SIM-RAW-001"):
            camera.capabilities()
        camera.close()


def test_a_camera_that_does_not_come_back_is_lost(
    rig: SimulatedRig, timeline: LiveTimeline, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connection, "REPLUG_SECONDS", 0.05)
    monkeypatch.setattr(connection, "_LOOK_EVERY", 0.01)
    server, _ = served(rig, timeline, "generic")
    with server:
        (camera,) = cameras_at([(server.host, server.port)], CLOCK)
        camera.identify()
    opened = []
    open_again = camera._connection.open

    def counted() -> StandardBody:
        opened.append(1)
        return open_again()

    monkeypatch.setattr(camera._connection, "open", counted)
    with pytest.raises(CameraGone, match=r"Camera SIM-RAW-001 does not come back: .*connection refused"):
        camera.set_exposure(WANTED)
    assert len(opened) == 1


def test_connections_leave_nothing_open(rig: SimulatedRig, timeline: LiveTimeline) -> None:
    server, _ = served(rig, timeline, "nikon-z6")
    with server:
        (camera,) = cameras_at([(server.host, server.port)], CLOCK)
        counts = []
        for _ in range(40):
            camera.capabilities()
            camera.close()
            heard = sum(thread.name.startswith("events of") for thread in threading.enumerate())
            counts.append((len(list(Path("/proc/self/fd").iterdir())), heard))
    assert all(heard == 0 for _, heard in counts)
    assert max(open_ for open_, _ in counts) <= counts[0][0] + 4  # of the server, which closes by and by

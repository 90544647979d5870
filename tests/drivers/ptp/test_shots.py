"""Whole shots with the simulated cameras of every make, on the virtual bus: faults, cables, and truth."""

import math
from collections.abc import Callable
from dataclasses import replace

import pytest

from drivers.camera import CameraFile
from drivers.errors import CameraClaimed, CameraLost, CameraPermission, CameraRefused
from drivers.ptp import PtpCamera, find_cameras
from drivers.ptp.protocol.codec import Event
from drivers.ptp.protocol.codes import EventCode
from drivers.sim.camera.camera import SimulatedCamera
from drivers.sim.faults import Fault, FaultPlan, Kind
from drivers.sim.ptp.profiles import PROFILES, profile
from drivers.sim.ptp.responder import Responder
from drivers.sim.ptp.usb_device import PtpDevice
from drivers.sim.rigs import SimulatedRig, simulate
from drivers.sim.usb.bus import Holder, VirtualBus
from drivers.sim.usb.virtual_clock import VirtualClock
from imaging.errors import CameraError
from imaging.files.tiff.dng import encode_dng
from imaging.optics.exposure import Exposure
from imaging.sensor.mosaic import RawMosaic
from tests.drivers.shots import shot

EXPOSURE = Exposure(time=1 / 125, f_number=5.6, iso=200)
SHOOTING = {
    "generic": "INITIATE_CAPTURE",
    "canon-eos-6d": "REMOTE_RELEASE_ON",
    "canon-eos-r7": "REMOTE_RELEASE_ON",
    "nikon-z6": "INITIATE_CAPTURE_REC_IN_MEDIA",
    "sony-a7m4": "SET_CONTROL_B",
}


@pytest.fixture(scope="module")
def rigs() -> dict[str, SimulatedRig]:
    return {name: simulate(name) for name in ("toy", "toy-ldr")}


class Bench:
    """A virtual bus with cameras of one profile."""

    def __init__(self, rig: SimulatedRig, name: str, *faults: Fault, cameras: int = 1) -> None:
        self.rig, self.clock = rig, VirtualClock()
        self.bus = VirtualBus(self.clock)
        self.plan = FaultPlan(self.clock, faults)
        self.devices = []
        for index in range(cameras):
            body = SimulatedCamera(rig.bodies[index], lambda frame, index=index: rig.radiance(index, frame))
            self.devices.append(PtpDevice(Responder(body, profile(name), self.clock, self.plan)))
            self.bus.plug(self.devices[-1])
        self.camera = find_cameras(self.bus, self.clock)[0]

    def truth(self, exposure: Exposure) -> RawMosaic | CameraFile:
        """The first shot at an exposure, taken without any bus between."""
        return shot(SimulatedCamera(self.rig.bodies[0], lambda frame: self.rig.radiance(0, frame)), exposure)


def same(one: RawMosaic | CameraFile, other: RawMosaic | CameraFile) -> bool:
    """To the byte, a mosaic being the file that a simulated body makes of it."""
    ours, theirs = (
        encode_dng(frame) if isinstance(frame, RawMosaic) else frame.data for frame in (one, other)
    )
    return ours == theirs


@pytest.mark.parametrize("name", PROFILES)
def test_a_shot_is_the_one_that_the_sensor_made(rigs: dict[str, SimulatedRig], name: str) -> None:
    bench = Bench(rigs["toy"], name)
    camera = bench.camera
    who = camera.identify()
    assert (who.serial, who.model, who.kind) == ("SIM-RAW-001", PROFILES[name].model, "raw")
    for time in (1 / 125, 2.0, 1 / 15):
        wanted = EXPOSURE.with_time(time)
        assert camera.set_exposure(wanted) == wanted
        camera.arm()
        before = bench.clock.now()
        opened = camera.trigger()
        assert before <= opened <= before + 0.5
        frame = camera.collect()
        assert frame.metadata.exposure is not None
        assert math.isclose(frame.metadata.exposure.time, time, rel_tol=1e-5)
        assert camera.dials.certain
        assert camera.dials.confirmed
        assert same(frame, bench.truth(wanted))
    camera.close()
    assert bench.bus.open_handles == 0


@pytest.mark.parametrize("name", PROFILES)
def test_capabilities_are_what_the_dials_list(rigs: dict[str, SimulatedRig], name: str) -> None:
    bench = Bench(rigs["toy"], name)
    stated, true = bench.camera.capabilities(), bench.devices[0].responder.shooting.camera.capabilities()
    assert stated.isos == true.isos
    assert stated.f_numbers == true.f_numbers
    for time in stated.times:
        assert min(abs(math.log2(time / one)) for one in true.times) < 1 / 6
    assert len(stated.times) == len(true.times) - 2 * (name == "generic")  # ticks hide two of them
    bench.camera.set_exposure(EXPOSURE)
    bench.camera.arm()
    bench.camera.trigger()
    bench.camera.collect()
    stated = bench.camera.capabilities()
    assert (stated.width, stated.height, stated.bit_depth) == (true.width, true.height, true.bit_depth)


def test_a_developing_camera_gives_its_own_bytes(rigs: dict[str, SimulatedRig]) -> None:
    bench = Bench(rigs["toy-ldr"], "generic")
    frame = shot(bench.camera, EXPOSURE)
    assert isinstance(frame, CameraFile)
    assert frame.suffix == ".jpg"
    assert same(frame, bench.truth(EXPOSURE))


def test_a_time_that_ticks_leave_open_is_uncertain_until_a_file_tells(rigs: dict[str, SimulatedRig]) -> None:
    camera = Bench(rigs["toy"], "generic").camera
    assert camera.set_exposure(EXPOSURE).time == 1 / 125
    assert camera.dials.certain
    wanted = EXPOSURE.with_time(1 / 8000)
    assert camera.set_exposure(wanted).time == 1 / 8000
    assert not camera.dials.certain
    shot(camera, wanted)
    assert camera.dials.confirmed
    assert camera.set_exposure(wanted).time == 1 / 8000
    assert camera.dials.certain
    # Of 2 ticks, this body makes 1/5000 s, and its file says so.
    wanted = EXPOSURE.with_time(1 / 4000)
    assert camera.set_exposure(wanted).time == 1 / 4000
    assert not camera.dials.certain
    frame = shot(camera, wanted)
    assert frame.metadata.exposure is not None
    assert math.isclose(frame.metadata.exposure.time, 1 / 5000, rel_tol=1e-5)
    assert not camera.dials.confirmed
    assert camera.set_exposure(wanted).time in (1 / 5000, 1 / 3200)
    assert camera.dials.certain


def test_a_file_is_held_against_the_setting_of_its_own_shot(rigs: dict[str, SimulatedRig]) -> None:
    """And not of the next, for which the camera is set before the file is fetched."""
    camera = Bench(rigs["toy"], "generic").camera
    camera.set_exposure(EXPOSURE.with_time(1 / 8000))
    camera.arm()
    camera.trigger()
    stored = camera.keep()
    camera.set_exposure(EXPOSURE)
    camera.fetch(stored)
    assert camera.dials.confirmed
    camera.set_exposure(EXPOSURE.with_time(1 / 8000))
    assert camera.dials.certain  # the file told what a tick means


# The makes tell of a shot when they are asked: nothing is sent that may be lost.
EVENT_FAULTS = [
    ("generic", Kind.LOST_EVENT),
    *((name, kind) for name in PROFILES for kind in (Kind.LATE_EVENT, Kind.REORDERED_EVENTS, Kind.SLOW_CARD)),
]


@pytest.mark.parametrize(("name", "kind"), EVENT_FAULTS)
def test_events_may_be_lost_late_or_reordered(rigs: dict[str, SimulatedRig], name: str, kind: Kind) -> None:
    fault = Fault(kind, operation=SHOOTING[name], nth=0, seconds=0.7, count=1)
    bench = Bench(rigs["toy"], name, fault)
    assert same(shot(bench.camera, EXPOSURE), bench.truth(EXPOSURE))
    again = shot(bench.camera, EXPOSURE.with_time(1.0))
    assert same(again, bench.truth(EXPOSURE.with_time(1.0)))
    assert bench.clock.now() < 6.0
    assert {one.fault.kind for one in bench.plan.log} == {kind}


def test_an_operation_of_every_kind_may_fail_in_every_way(rigs: dict[str, SimulatedRig]) -> None:
    """One fault a run, the first time that an operation is used; the shot is right all the same."""
    kinds = (
        Fault(Kind.BUSY, seconds=0.05),
        Fault(Kind.BUSY, count=3),
        Fault(Kind.STALL),
        Fault(Kind.TRUNCATED, count=3),
        Fault(Kind.WRONG_TRANSACTION),
        Fault(Kind.SPLIT_HEADER),
        Fault(Kind.MERGED_RESPONSE),
        Fault(Kind.CORRUPT_LENGTH, count=4),
        Fault(Kind.TIMEOUT),
        Fault(Kind.UNPLUG, seconds=0.3, count=5),
    )
    operations = (
        "GET_DEVICE_INFO",
        "GET_DEVICE_PROP_DESC",
        "SET_DEVICE_PROP_VALUE",
        "GET_OBJECT_INFO",
        "GET_PARTIAL_OBJECT",
    )
    of_data = {Kind.TRUNCATED, Kind.SPLIT_HEADER, Kind.MERGED_RESPONSE}
    for operation in operations:
        for fault in kinds:
            one = Fault(fault.kind, operation=operation, seconds=fault.seconds, count=fault.count)
            bench = Bench(rigs["toy"], "generic", one)
            try:
                frame = shot(bench.camera, EXPOSURE)
            except CameraError as error:
                raise AssertionError(f"{one} in {operation}") from error
            assert same(frame, bench.truth(EXPOSURE)), str(one)
            struck = [(happened.operation, happened.fault.kind) for happened in bench.plan.log]
            # Identification is never busy, and only what sends data can damage it.
            unable = one.kind is Kind.BUSY if operation == "GET_DEVICE_INFO" else one.kind in of_data
            if not (unable and operation in ("GET_DEVICE_INFO", "SET_DEVICE_PROP_VALUE")):
                assert struck == [(operation, one.kind)]


@pytest.mark.parametrize("name", PROFILES)
@pytest.mark.parametrize("kind", [Kind.BUSY, Kind.STALL, Kind.TIMEOUT, Kind.UNPLUG])
def test_a_release_that_fails_is_told_and_the_next_shot_is_right(
    rigs: dict[str, SimulatedRig], name: str, kind: Kind
) -> None:
    fault = Fault(kind, operation=SHOOTING[name], seconds=0.3)
    bench = Bench(rigs["toy"], name, fault)
    for attempt in range(3):
        try:
            frame = shot(bench.camera, EXPOSURE)
            break
        except CameraError:
            assert kind is not Kind.BUSY
            assert attempt < 2
    assert frame.metadata.exposure is not None
    assert math.isclose(frame.metadata.exposure.time, EXPOSURE.time, rel_tol=1e-5)


@pytest.mark.parametrize("name", PROFILES)
def test_a_camera_is_found_again_at_its_new_address(rigs: dict[str, SimulatedRig], name: str) -> None:
    bench = Bench(rigs["toy"], name, cameras=2)
    camera = bench.camera
    camera.set_exposure(EXPOSURE)
    before = camera.where
    bench.bus.unplug("SIM-RAW-001")
    bench.clock.call_later(1.5, lambda: bench.bus.plug(bench.devices[0]) and None)
    frame = shot(camera, EXPOSURE)
    assert frame.metadata.serial == "SIM-RAW-001"
    assert camera.where != before
    bench.bus.unplug("SIM-RAW-001")
    with pytest.raises(CameraLost, match="SIM-RAW-001"):
        camera.set_exposure(EXPOSURE)


def test_a_shot_on_the_card_survives_the_cable(rigs: dict[str, SimulatedRig]) -> None:
    """Unplugged within the download: the file goes on where it broke off, in the next session."""
    fault = Fault(Kind.UNPLUG, operation="GET_PARTIAL_OBJECT", seconds=0.5, count=2000)
    bench = Bench(rigs["toy"], "generic", fault)
    assert same(shot(bench.camera, EXPOSURE), bench.truth(EXPOSURE))
    assert [one.operation for one in bench.plan.log] == ["GET_PARTIAL_OBJECT"]
    assert bench.plan._counts["SIM-RAW-001", "INITIATE_CAPTURE"] == 1


def test_a_full_card_is_refused(rigs: dict[str, SimulatedRig]) -> None:
    bench = Bench(rigs["toy"], "generic", Fault(Kind.STORE_FULL, operation="INITIATE_CAPTURE"))
    with pytest.raises(CameraRefused, match="free its card"):
        shot(bench.camera, EXPOSURE)


@pytest.mark.parametrize(
    "events",
    [
        (EventCode.OBJECT_ADDED, EventCode.STORE_FULL),
        (EventCode.STORE_FULL, EventCode.OBJECT_ADDED),
        (EventCode.STORE_FULL,),
    ],
)
def test_the_last_picture_that_a_card_holds_is_taken(
    rigs: dict[str, SimulatedRig], events: tuple[int, ...]
) -> None:
    bench = Bench(rigs["toy"], "generic")
    responder = bench.devices[0].responder
    tell = responder.listener
    assert tell is not None

    def tell_full(event: Event) -> None:
        for code in events if event.code == EventCode.OBJECT_ADDED else (event.code,):
            tell(replace(event, code=code))

    responder.listener = tell_full
    assert same(shot(bench.camera, EXPOSURE), bench.truth(EXPOSURE))


@pytest.mark.parametrize("act", [PtpCamera.arm, PtpCamera.trigger, PtpCamera.collect])
def test_out_of_order_is_an_error(rigs: dict[str, SimulatedRig], act: Callable[[PtpCamera], object]) -> None:
    with pytest.raises(CameraError, match="in this order"):
        act(Bench(rigs["toy"], "generic").camera)


@pytest.mark.parametrize(
    ("holder", "kind"),
    [
        (Holder.PERMISSIONS, CameraPermission),
        (Holder.OTHER_PROGRAM, CameraClaimed),
        (Holder.KERNEL_DRIVER, CameraClaimed),
    ],
)
def test_a_camera_that_others_hold_says_so_until_they_let_go(
    rigs: dict[str, SimulatedRig], holder: Holder, kind: type[CameraError]
) -> None:
    bench = Bench(rigs["toy"], "generic")
    bench.bus.hold("SIM-RAW-001", holder)
    for _ in range(2):
        with pytest.raises(kind):
            bench.camera.identify()
        assert bench.bus.open_handles == 0
    bench.bus.hold("SIM-RAW-001", Holder.NOBODY)
    assert bench.camera.identify().serial == "SIM-RAW-001"


def test_cameras_of_one_model_are_told_apart_when_both_come_back(rigs: dict[str, SimulatedRig]) -> None:
    bench = Bench(rigs["toy"], "generic", cameras=2)
    cameras = find_cameras(bench.bus, bench.clock)
    serials = [camera.identify().serial for camera in cameras]
    assert serials == ["SIM-RAW-001", "SIM-RAW-002"]
    for serial in serials:
        bench.bus.unplug(serial)
    for device in reversed(bench.devices):
        bench.bus.plug(device)
    for camera, serial in zip(cameras, serials, strict=True):
        assert shot(camera, EXPOSURE).metadata.serial == serial

"""Cameras that refuse what not every camera can do: they are known, used as far as they go, or left out."""

import numpy as np
import pytest

from capture.rigfile.template import rig_file_text
from drivers.camera import CameraFile
from drivers.discovery import ConnectedCamera, ask_all
from drivers.errors import CameraRefused
from drivers.ptp import PtpCamera, find_cameras
from drivers.ptp.protocol.codes import CanonOperation, NikonOperation, Operation, ResponseCode, SonyOperation
from drivers.sim.camera.camera import SimulatedCamera
from drivers.sim.ptp.operations import Handler, Reply, Request
from drivers.sim.ptp.profiles import PROFILES, profile
from drivers.sim.ptp.responder import Responder
from drivers.sim.ptp.store import STORAGE
from drivers.sim.ptp.usb_device import PtpDevice
from drivers.sim.rigs import SimulatedRig, simulate
from drivers.sim.usb.bus import VirtualBus
from drivers.sim.usb.virtual_clock import VirtualClock
from imaging.errors import CaptureError
from imaging.optics.exposure import Exposure
from rig.commands import cameras

NEEDED = (Operation.OPEN_SESSION, Operation.CLOSE_SESSION, Operation.GET_DEVICE_INFO)
RELEASES = {
    "generic": (Operation.INITIATE_CAPTURE,),
    "canon-eos-6d": (CanonOperation.REMOTE_RELEASE, CanonOperation.REMOTE_RELEASE_ON),
    "canon-eos-r7": (CanonOperation.REMOTE_RELEASE, CanonOperation.REMOTE_RELEASE_ON),
    "nikon-z6": (
        Operation.INITIATE_CAPTURE,
        NikonOperation.INITIATE_CAPTURE_REC_IN_SDRAM,
        NikonOperation.INITIATE_CAPTURE_REC_IN_MEDIA,
    ),
    "sony-a7m4": (Operation.INITIATE_CAPTURE, SonyOperation.SDIO_CONNECT),
}


@pytest.fixture(scope="module")
def toy() -> SimulatedRig:
    return simulate("toy")


class Bench:
    """A camera of a profile on a bus."""

    def __init__(self, rig: SimulatedRig, name: str) -> None:
        lens = rig.bodies[0].optics.lens
        view = np.full((lens.height, lens.width, 3), 0.2, np.float32)
        body = SimulatedCamera(rig.bodies[0], lambda frame: view)
        self.clock = VirtualClock()
        self.bus = VirtualBus(self.clock)
        self.responder = Responder(body, profile(name), self.clock)
        self.bus.plug(PtpDevice(self.responder))

    def camera(self) -> PtpCamera:
        return find_cameras(self.bus, self.clock)[0]

    def listed(self) -> ConnectedCamera:
        (one,) = ask_all(self.bus, self.clock)
        return one


@pytest.mark.parametrize("code", [ResponseCode.OPERATION_NOT_SUPPORTED, ResponseCode.INVALID_STORAGE_ID])
@pytest.mark.parametrize("name", PROFILES)
def test_a_camera_that_refuses_any_one_operation_is_still_identified(
    toy: SimulatedRig, name: str, code: ResponseCode
) -> None:
    operations = [one for one in Bench(toy, name).responder._handlers if one not in NEEDED]
    assert len(operations) > 10
    for operation in operations:
        bench = Bench(toy, name)
        phase = bench.responder._handlers[operation].phase
        bench.responder._handlers[operation] = Handler(lambda request: Reply(code), phase)
        listed = bench.listed()
        assert listed.identity is not None, hex(operation)
        assert (listed.identity.serial, listed.identity.model) == ("SIM-RAW-001", profile(name).model)
        assert bool(listed.error) == (listed.capabilities is None)
        assert bench.bus.open_handles == 0


def test_a_camera_that_lists_one_storage_at_a_time_shoots(toy: SimulatedRig) -> None:
    """Act as uMTP-Responder: it answers 0x2008 to the storage 0xFFFFFFFF."""
    bench = Bench(toy, "generic")
    whole = bench.responder._handlers[Operation.GET_OBJECT_HANDLES]

    def one_by_one(request: Request) -> Reply:
        known = request.parameter(0) == STORAGE
        return whole.act(request) if known else Reply(ResponseCode.INVALID_STORAGE_ID)

    bench.responder._handlers[Operation.GET_OBJECT_HANDLES] = Handler(one_by_one, whole.phase)
    camera = bench.camera()
    assert camera.identify().serial == "SIM-RAW-001"
    camera.set_exposure(Exposure(time=1 / 60, f_number=5.6, iso=100))
    camera.arm()
    camera.trigger()
    assert isinstance(camera.collect(), CameraFile)
    camera.close()


@pytest.mark.parametrize("name", PROFILES)
def test_a_camera_that_cannot_be_triggered_says_so_and_is_left_out(toy: SimulatedRig, name: str) -> None:
    """Act as a Canon PowerShot SX200 IS, which lists no operation that exposes."""
    bench = Bench(toy, name)
    able = bench.listed()
    assert able.capabilities is not None
    assert (able.capabilities.obstacle, able.trouble) == ("", "")
    for operation in RELEASES[name]:
        bench.responder._handlers.pop(operation, None)
    listed = bench.listed()
    assert listed.capabilities is not None
    obstacle = "it takes no pictures on command"
    assert listed.capabilities.obstacle == obstacle
    who = f"{profile(name).maker} {profile(name).model} SIM-RAW-001"
    assert listed.trouble == f"{who} cannot shoot for rig: {obstacle}."
    assert f"    cannot shoot for rig: {obstacle}" in cameras._lines(listed)
    assert f"# Left out: {listed.trouble}" in rig_file_text([listed, able])
    with pytest.raises(CaptureError, match=f"no camera can be used .*{obstacle}"):
        rig_file_text([listed])


def test_a_camera_whose_time_cannot_be_set_says_so(toy: SimulatedRig) -> None:
    bench = Bench(toy, "generic")
    del bench.responder.shooting.dials[profile("generic").dials[0].code]
    listed = bench.listed()
    assert listed.capabilities is not None
    assert listed.capabilities.obstacle == "its exposure time cannot be set: turn its mode dial to M"
    with pytest.raises(CameraRefused, match="turn its mode dial to M"):
        bench.camera().set_exposure(Exposure(time=1 / 60))

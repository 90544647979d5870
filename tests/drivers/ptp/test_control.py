"""Control of a camera that refuses what does not matter, drops its session, or is let go amid a shot."""

from dataclasses import replace

import pytest

from drivers.ptp.protocol.codes import NikonOperation, Operation, ResponseCode
from drivers.sim.ptp.operations import Reply, Request
from drivers.sim.ptp.profiles import PROFILES
from drivers.sim.rigs import SimulatedRig, simulate
from imaging.errors import CameraError
from tests.drivers.ptp.test_shots import EXPOSURE, Bench, same, shot


@pytest.fixture(scope="module")
def toy() -> SimulatedRig:
    return simulate("toy")


@pytest.mark.parametrize(
    ("operation", "code"),
    [
        (Operation.GET_OBJECT_HANDLES, ResponseCode.STORE_NOT_AVAILABLE),
        (NikonOperation.CHANGE_CAMERA_MODE, ResponseCode.CHANGE_CAMERA_MODE_FAILED),
        (NikonOperation.DEVICE_READY, ResponseCode.SILENT_RELEASE_BUSY),
    ],
)
def test_a_nikon_shoots_whatever_it_says_of_what_does_not_matter(
    toy: SimulatedRig, operation: int, code: int
) -> None:
    """Without a card, in a mode that it keeps, or never called ready, as libgphoto2 knows some."""
    bench = Bench(toy, "nikon-z6")
    handlers = bench.devices[0].responder._handlers
    before = handlers[operation]

    def act(request: Request) -> Reply:
        reply = before.act(request)
        return reply if reply.code == ResponseCode.DEVICE_BUSY else Reply(code)

    handlers[operation] = replace(before, act=act)
    assert same(shot(bench.camera, EXPOSURE), bench.truth(EXPOSURE))
    bench.camera.close()


@pytest.mark.parametrize("name", sorted(PROFILES.keys() - {"generic"}))
def test_a_session_that_the_camera_drops_is_begun_anew_with_its_mode(toy: SimulatedRig, name: str) -> None:
    bench = Bench(toy, name)
    for _ in range(2):
        assert shot(bench.camera, EXPOSURE).metadata.exposure == EXPOSURE
        bench.devices[0].responder.reset()
    assert bench.bus.open_handles == 1


@pytest.mark.parametrize("name", PROFILES)
def test_what_was_turned_while_a_camera_was_let_go_is_set_again(toy: SimulatedRig, name: str) -> None:
    bench = Bench(toy, name)
    shot(bench.camera, EXPOSURE)
    bench.camera.close()
    shooting = bench.devices[0].responder.shooting
    shooting.exposure = shooting.exposure.with_time(1 / 1000)
    assert shot(bench.camera, EXPOSURE).metadata.exposure == EXPOSURE


@pytest.mark.parametrize(
    ("gone", "name"), [("closed", "generic"), ("unplugged", "generic"), ("found again", "canon-eos-6d")]
)
def test_a_shot_that_is_given_up_is_none_of_the_next(toy: SimulatedRig, gone: str, name: str) -> None:
    bench = Bench(toy, name)
    camera = bench.camera
    camera.set_exposure(EXPOSURE)
    camera.arm()
    camera.trigger()
    if gone == "closed":
        camera.close()
        with pytest.raises(CameraError, match="in this order"):
            camera.collect()
    else:
        bench.bus.unplug("SIM-RAW-001")
        if gone == "found again":
            bench.bus.plug(bench.devices[0])
        with pytest.raises(CameraError):
            camera.collect()
        if gone == "unplugged":
            bench.bus.plug(bench.devices[0])
    camera.arm()
    if gone == "found again":  # amid a shot, for which it was set before
        with pytest.raises(CameraError, match="in this order"):
            camera.trigger()
        camera.set_exposure(EXPOSURE)
        camera.arm()
    camera.trigger()
    assert camera.collect().metadata.exposure == EXPOSURE

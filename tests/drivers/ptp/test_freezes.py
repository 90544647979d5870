"""Cameras that stop answering or say what is new, as libgphoto2's users told: no shot is lost, or it is told.

An EOS R5 Mark II sends the data of some operations and no response (issue 1028 of libgphoto2); an EOS 5DS R
freezes over a capture for a while (688), or until somebody takes its cables off (456).
"""

from dataclasses import replace

import pytest

from drivers.errors import CameraBusy, CameraProtocol, CameraRefused
from drivers.ptp.protocol.codes import NikonProperty, ResponseCode, SonyOperation
from drivers.sim.faults import Fault, Kind
from drivers.sim.ptp.dials import SimulatedDial
from drivers.sim.ptp.operations import Reply
from drivers.sim.ptp.profiles import PROFILES
from drivers.sim.ptp.shooting import Shooting
from drivers.sim.ptp.store import Store
from drivers.sim.rigs import SimulatedRig, simulate
from imaging.errors import CameraError
from tests.drivers.ptp.test_shots import EXPOSURE, SHOOTING, Bench, same, shot

PATIENCE = 60.0
"""Seconds after which a shot has come, or it is told that it does not."""


@pytest.fixture(scope="module")
def toy() -> SimulatedRig:
    return simulate("toy")


@pytest.mark.parametrize("name", PROFILES)
@pytest.mark.parametrize("nth", range(1, 24, 3))
def test_a_response_that_does_not_come_costs_no_shot(name: str, nth: int, toy: SimulatedRig) -> None:
    bench = Bench(toy, name, Fault(Kind.NO_RESPONSE, nth=nth), Fault(Kind.NO_RESPONSE, nth=nth + 30))
    for _ in range(3):
        began = bench.clock.now()
        frame = shot(bench.camera, EXPOSURE)
        assert bench.clock.now() - began < 30.0
    assert bench.devices[0].responder.shooting.shots == 3
    assert same(shot(Bench(toy, name).camera, EXPOSURE), bench.truth(EXPOSURE))
    assert frame.metadata.exposure == EXPOSURE


@pytest.mark.parametrize("name", PROFILES)
@pytest.mark.parametrize("seconds", [1.0, 12.0, 300.0])
def test_a_body_that_freezes_over_a_capture_is_told_of_and_found_again(
    name: str, seconds: float, toy: SimulatedRig
) -> None:
    bench = Bench(toy, name, Fault(Kind.FREEZE, operation=SHOOTING[name], nth=1, seconds=seconds))
    began, lost = bench.clock.now(), False
    try:
        shot(bench.camera, EXPOSURE)
    except CameraError:
        lost = True
    assert bench.clock.now() - began < PATIENCE
    bench.clock.sleep(max(0.0, began + seconds + 1.0 - bench.clock.now()))
    frames = [shot(bench.camera, EXPOSURE) for _ in range(2 if lost else 1)]
    assert all(frame.metadata.exposure == EXPOSURE for frame in frames)
    assert bench.bus.open_handles == 1


NIKON, SONY, CANON = "nikon-z6", "sony-a7m4", "canon-eos-r7"
BULB = 0xFFFFFFFF


@pytest.mark.parametrize("nth", [1, 2, 3, 4])
def test_a_nikon_whose_shutter_is_open_in_bulb_is_waited_for(nth: int, toy: SimulatedRig) -> None:
    """A Z 50 answers so (issue 588 of libgphoto2), and is not wrong to."""
    bench = Bench(toy, NIKON, Fault(Kind.BULB, operation="DEVICE_READY", nth=nth, seconds=1.5))
    for _ in range(3):
        frame = shot(bench.camera, EXPOSURE)
        assert frame.metadata.exposure == EXPOSURE
    assert bench.devices[0].responder.shooting.shots == 3
    assert len(bench.plan.log) == 1


def test_one_that_nobody_closes_is_told_with_what_to_do(toy: SimulatedRig) -> None:
    bench = Bench(toy, NIKON, Fault(Kind.BULB, operation="DEVICE_READY", nth=1, seconds=3600.0))
    with pytest.raises(
        CameraBusy, match=r"its shutter is open in bulb mode: end the exposure.* turn its dial to M"
    ):
        shot(bench.camera, EXPOSURE)
    assert bench.clock.now() < PATIENCE


def test_a_nikon_that_stands_at_bulb_is_set_to_a_time(
    toy: SimulatedRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown, turn, turned = Shooting.shown, Shooting.turn, set()

    def bulb_at_first(shooting: Shooting, dial: SimulatedDial) -> int:
        at_bulb = dial.code == NikonProperty.SHUTTER_SPEED and dial.code not in turned
        return BULB if at_bulb else shown(shooting, dial)

    def noted(shooting: Shooting, dial: SimulatedDial, number: int) -> bool:
        turned.add(dial.code)
        return turn(shooting, dial, number)

    monkeypatch.setattr(Shooting, "shown", bulb_at_first)
    monkeypatch.setattr(Shooting, "turn", noted)
    assert shot(Bench(toy, NIKON).camera, EXPOSURE).metadata.exposure == EXPOSURE
    assert NikonProperty.SHUTTER_SPEED in turned


@pytest.mark.parametrize("operation", ["GET_OBJECT", "GET_OBJECT_INFO"])
@pytest.mark.parametrize("seconds", [0.2, 2.0])
def test_a_sony_that_hangs_when_its_objects_are_listed_is_not_asked_to(
    operation: str, seconds: float, toy: SimulatedRig
) -> None:
    """Bodies before 2020 do, for good (commit 10870c84 of libgphoto2); a cable that comes out led there."""
    bench = Bench(
        toy, SONY, Fault(Kind.FREEZE, operation="GET_OBJECT_HANDLES", nth=0, seconds=3600.0),
        Fault(Kind.UNPLUG, operation=operation, nth=1, count=20, seconds=seconds),
    )  # fmt: skip
    refusal = ""
    try:
        shot(bench.camera, EXPOSURE)
    except CameraRefused as error:
        refusal = str(error)
    assert not refusal or refusal.endswith(("take it again.", "take the shot again."))
    assert bench.clock.now() < PATIENCE
    for _ in range(2):
        assert shot(bench.camera, EXPOSURE).metadata.exposure == EXPOSURE
    assert [one.fault.kind for one in bench.plan.log] == [Kind.UNPLUG]


def test_a_sony_of_another_protocol_is_told_and_left_to_libgphoto2(toy: SimulatedRig) -> None:
    """One that speaks version 3 alone: refused, so that `drivers/choice.py` asks libgphoto2."""
    bench = Bench(toy, SONY)
    handlers = bench.devices[0].responder._handlers
    handler = handlers[SonyOperation.GET_EXT_DEVICE_INFO]
    handlers[SonyOperation.GET_EXT_DEVICE_INFO] = replace(
        handler,
        act=lambda request: (
            handler.act(request) if request.parameter(0) >= 300 else Reply(ResponseCode.INVALID_PARAMETER)
        ),
    )
    with pytest.raises(
        CameraRefused, match=r"does not support version 2 of Sony's protocol.*install libgphoto2"
    ):
        bench.camera.capabilities()


def test_a_file_beyond_four_gibibytes_is_told_before_any_of_it_is_read(
    toy: SimulatedRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its record has 64 bits for the size, and an offset has 32."""
    as_it_is = Store.object_info

    def huge(store: Store, handle: int):  # type: ignore[no-untyped-def]
        info = as_it_is(store, handle)
        return None if info is None else replace(info, size=5 << 30)

    monkeypatch.setattr(Store, "object_info", huge)
    bench = Bench(toy, CANON)
    with pytest.raises(CameraProtocol, match=r"with 5120 MiB, too large for a picture: shoot it again"):
        shot(bench.camera, EXPOSURE)
    monkeypatch.undo()
    assert shot(bench.camera, EXPOSURE).metadata.exposure == EXPOSURE

"""Cameras that stop answering, as users of libgphoto2 have told: no shot is lost, or the time is told.

An EOS R5 Mark II sends the data of some operations and no response; an EOS 5DS R freezes over a capture until
somebody takes its cables off.
"""

import pytest

from drivers.sim.faults import Fault, Kind
from drivers.sim.ptp.profiles import PROFILES
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

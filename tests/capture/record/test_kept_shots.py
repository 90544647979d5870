"""Cameras with a card: a shot is fetched while the next one exposes, and is the right one all the same."""

from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from capture.check.check import check
from capture.record.capture_result import CaptureResult
from capture.record.recorder import record
from drivers.errors import CameraBusy
from drivers.ptp import PtpCamera
from drivers.sim.bus_rig import BusRig
from drivers.sim.faults import Fault, Kind
from drivers.sim.rigs import simulate
from imaging.files.raw import read_raw
from imaging.optics.exposure import Exposure
from imaging.session.records import PlanRecord, SessionRecord
from imaging.session.session import Session
from tests.capture.conftest import WHEN
from tests.trees import tree

TIMES = (4.0, 1 / 8, 4.0, 2.0)
SLOW = 4000.0
"""Bytes per second: a picture of 6 kB takes 1.7 s."""


class Capture:
    """Two frames of a bracket by two cameras on the virtual bus."""

    def __init__(
        self,
        folder: Path,
        faults: Sequence[Fault] = (),
        times: Sequence[float] = TIMES,
        bandwidth: float | None = SLOW,
        model: str = "generic",
    ) -> None:
        rig = simulate("toy", 1, positions=2, samples=1)
        self.bus = BusRig(rig, faults, model=model, bandwidth=bandwidth)
        self.names = [one.name for one in rig.records()]
        self.cameras = dict(zip(self.names, self.bus.cameras(), strict=True))
        identity = SessionRecord(name="kept", created=WHEN, origin="test", cameras=rig.records())
        self.session = Session.create(folder, identity)
        plan = PlanRecord(
            plan="scene",
            kind="scene",
            created=WHEN,
            bracket=tuple(Exposure(time=time, f_number=4.0, iso=100.0) for time in times),
            frames=(0, 1),
            cameras=tuple(self.names),
            reason="test",
        )
        self.session.append_plan(plan)
        began = self.bus.clock.now()
        self.result: CaptureResult = record(
            self.session, plan, self.cameras, clock=self.bus.clock, move_to=rig.move_to
        )
        self.seconds = self.bus.clock.now() - began
        assert check(folder).sound

    def files(self) -> dict[str, bytes]:
        return tree(self.session.folder / "raw", "*.dng")

    def retried(self) -> set[tuple[str, int, int]]:
        return {(shot.camera, shot.frame, shot.step) for shot in self.session.shots() if shot.retries}


@pytest.fixture
def capture(tmp_path: Path) -> Callable[..., Capture]:
    return lambda name, *faults, **options: Capture(tmp_path / name, faults, **options)


def test_downloads_cost_no_time_while_the_next_shot_exposes(capture, monkeypatch) -> None:
    pipelined = capture("kept")
    with monkeypatch.context() as one_by_one:
        one_by_one.setattr(PtpCamera, "keeps", lambda self: False)
        fetched = capture("fetched")
    assert pipelined.result.missing == fetched.result.missing == ()
    assert pipelined.files() == fetched.files()
    assert pipelined.retried() == set()
    # Of each frame's four downloads two pass while 4 s and 2 s are exposed, one partly; the last waits.
    download = len(next(iter(pipelined.files().values()))) / SLOW
    assert 2 * 2 * download < fetched.seconds - pipelined.seconds < 2 * 3 * download


@pytest.mark.parametrize("model", ["nikon-z6", "sony-a7m4"])
def test_bodies_that_forget_a_shot_are_emptied_first(capture, model: str, monkeypatch) -> None:
    def refuse(self) -> None:
        raise AssertionError("it was asked to keep a shot")

    monkeypatch.setattr(PtpCamera, "keep", refuse)
    assert capture(model, model=model, times=(1 / 8, 1 / 60)).result.missing == ()


def test_a_body_that_is_busy_while_it_exposes_is_emptied_first_from_then_on(
    capture, whole: Capture, monkeypatch
) -> None:
    fetch, refused = PtpCamera.fetch, []

    def busy(self, handle):
        if self._shot is not None and handle.objects is not self._shot.objects:
            refused.append(self)
            self._clock.sleep(1.0)
            raise CameraBusy("it stays busy.")
        return fetch(self, handle)

    monkeypatch.setattr(PtpCamera, "fetch", busy)
    captured = capture("busy")
    right(captured, whole)
    assert captured.retried() == set()
    assert len(refused) == len(set(refused)) == 2


def right(captured: Capture, whole: Capture) -> None:
    """All shots are there, as they were asked for; of a camera's exposures none of which was taken again, the
    bytes are those of a capture without faults."""
    assert (captured.result.missing, captured.result.problems) == ((), ())
    again = {(camera, TIMES[step]) for camera, _, step in captured.retried()}
    files, truth = captured.files(), whole.files()
    for shot in captured.session.shots():
        exposure = read_raw(captured.session.file(shot)).metadata.exposure
        assert exposure is not None
        assert exposure.time == pytest.approx(shot.requested.time, rel=0.03)
        place = shot.file.removeprefix("raw/")
        assert (shot.camera, shot.requested.time) in again or files[place] == truth[place], place


FAULTS = [
    Fault(Kind.UNPLUG, operation="GET_PARTIAL_OBJECT", nth=2, seconds=0.5, count=2000),
    Fault(Kind.UNPLUG, operation="GET_OBJECT_INFO", nth=2, seconds=3.0, count=20),
    Fault(Kind.UNPLUG, operation="INITIATE_CAPTURE", nth=2, seconds=0.5, count=1),
    Fault(Kind.STALL, operation="GET_PARTIAL_OBJECT", nth=4),
    Fault(Kind.TIMEOUT, operation="GET_PARTIAL_OBJECT", nth=2),
    Fault(Kind.TIMEOUT, operation="INITIATE_CAPTURE", nth=4),
    Fault(Kind.BUSY, operation="INITIATE_CAPTURE", nth=2, seconds=2.0),
    Fault(Kind.CORRUPT_LENGTH, operation="GET_PARTIAL_OBJECT", nth=2, count=4),
]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Capture:
    return Capture(tmp_path_factory.mktemp("whole") / "session")


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: f"{fault.operation}-{fault.kind.value}")
def test_faults_while_two_shots_are_in_the_camera(capture, whole: Capture, fault: Fault) -> None:
    captured = capture("faulty", fault)
    assert len(captured.bus.plan.log) == 2
    right(captured, whole)


@pytest.mark.parametrize("kind", [Kind.LOST_EVENT, Kind.LATE_EVENT, Kind.SLOW_CARD])
def test_events_of_two_shots_are_not_confused(capture, whole: Capture, kind: Kind) -> None:
    captured = capture("faulty", Fault(kind, operation="INITIATE_CAPTURE", nth=0, seconds=1.5, count=2))
    right(captured, whole)
    assert captured.retried() == set()


def test_a_frame_of_another_exposure_is_noticed_a_shot_later(capture, whole: Capture) -> None:
    captured = capture("off", Fault(Kind.EXPOSURE_OFF, operation="INITIATE_CAPTURE", nth=2, share=1.0))
    right(captured, whole)
    assert {step for _, _, step in captured.retried()} == {1}

"""Brackets that a body shoots by itself: faster, the same records, and one by one whenever it does not."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from capture.check.check import check
from capture.record.recorder import record
from drivers.errors import CameraRefused
from drivers.ptp import PtpCamera
from drivers.ptp.protocol.codes import PropertyCode, ResponseCode
from drivers.sim.bus_rig import BusRig
from drivers.sim.faults import Fault, Kind
from drivers.sim.ptp import profiles
from drivers.sim.ptp.properties import SimulatedProperties
from drivers.sim.rigs import simulate
from imaging.errors import StorageError
from imaging.files import store
from imaging.optics.exposure import Exposure
from imaging.session.records import PlanRecord, SessionRecord, ShotRecord
from imaging.session.session import Session
from tests.capture.conftest import WHEN

STOPS = (1 / 500, 1 / 250, 1 / 125, 1 / 60)
TWO_STOPS = (1 / 250, 1 / 60, 1 / 15)
UNEVEN = (1 / 500, 1 / 60, 1 / 30, 1 / 4)
MAKES = ("canon-eos-6d", "nikon-z6", "sony-a7m4")
PRESS = {
    "sony-a7m4": ("SET_CONTROL_B", 2),
    "canon-eos-6d": ("REMOTE_RELEASE_ON", 2),
    "nikon-z6": ("INITIATE_CAPTURE_REC_IN_MEDIA", 1),
}
SHARE = {"sony-a7m4": 0.5, "nikon-z6": 0.65, "canon-eos-6d": 0.8}
"""Share of the time one by one: four frames are in a bracket of five of Sony and Nikon, three and one of
Canon.
"""
FETCH = {"sony-a7m4": "GET_OBJECT", "nikon-z6": "GET_OBJECT", "canon-eos-6d": "GET_PARTIAL_OBJECT"}


class Capture:
    """Frames of a bracket by the cameras of a simulated rig on the virtual bus; brackets: how often asked."""

    def __init__(
        self,
        folder: Path,
        model: str,
        times: Sequence[float] = STOPS,
        faults: Sequence[Fault] = (),
        cameras: int = 1,
        frames: int = 2,
        *,
        complete: bool = True,
    ) -> None:
        self.rig = simulate("toy", 1, cameras=cameras, positions=frames, samples=1)
        self.bus = BusRig(self.rig, faults, model=model)
        names = [one.name for one in self.rig.records()]
        self.cameras = dict(zip(names, self.bus.cameras(), strict=True))
        identity = SessionRecord(name="own", created=WHEN, origin="test", cameras=self.rig.records())
        self.session = Session.create(folder, identity)
        self.plan = PlanRecord(
            plan="scene",
            kind="scene",
            created=WHEN,
            bracket=tuple(Exposure(time=time, f_number=4.0, iso=100.0) for time in times),
            frames=tuple(range(frames)),
            cameras=tuple(names),
            reason="test",
        )
        self.session.append_plan(self.plan)
        self.shoot(complete=complete)

    def shoot(self, *, complete: bool = True) -> None:
        began = self.bus.clock.now()
        self.result = record(
            self.session, self.plan, self.cameras, clock=self.bus.clock, move_to=self.rig.move_to
        )
        self.seconds = self.bus.clock.now() - began
        if not complete:
            return
        assert (self.result.missing, self.result.problems) == ((), ())
        for shot in self.shots.values():
            assert shot.reported == shot.requested == self.plan.bracket[shot.step]
        assert len(self.shots) == len(self.plan.bracket) * len(self.plan.frames) * len(self.cameras)
        assert check(self.session.folder).sound

    @property
    def shots(self) -> dict[tuple[str, int, int], ShotRecord]:
        return {(shot.camera, shot.frame, shot.step): shot for shot in self.session.shots()}

    def retried(self) -> set[tuple[int, int]]:
        return {(frame, step) for (_, frame, step), shot in self.shots.items() if shot.retries}


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """An entry for each bracket that a camera was asked for: whether it was shot to its end."""
    bracket_of_camera, log = PtpCamera.bracket, list[bool]()

    def bracket(self: PtpCamera, wanted: Sequence[Exposure]) -> object:
        log.append(False)
        yield from bracket_of_camera(self, wanted)
        log[-1] = True

    monkeypatch.setattr(PtpCamera, "bracket", bracket)
    return log


def one_by_one(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuses(self: PtpCamera, wanted: Sequence[Exposure]) -> object:
        raise CameraRefused("none of its own.")

    monkeypatch.setattr(PtpCamera, "bracket", refuses)


@pytest.mark.parametrize("model", MAKES)
def test_the_records_are_those_of_single_exposures_and_it_is_faster(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, asked: list[bool], model: str
) -> None:
    monkeypatch.setitem(profiles.PROFILES, model, replace(profiles.PROFILES[model], lag=0.3))
    in_camera = Capture(tmp_path / "own", model)
    assert asked == [True] * 2
    one_by_one(monkeypatch)
    single = Capture(tmp_path / "single", model)
    assert in_camera.seconds < SHARE[model] * single.seconds
    # The noise is that of the order of shooting.
    of_pixels = {"sha256", "captured_at"}
    assert {key: shot.model_dump(exclude=of_pixels) for key, shot in in_camera.shots.items()} == {
        key: shot.model_dump(exclude=of_pixels) for key, shot in single.shots.items()
    }


@pytest.mark.parametrize("model", ["generic", *MAKES])
def test_a_bracket_that_the_body_has_not_is_asked_for_once(
    tmp_path: Path, asked: list[bool], model: str
) -> None:
    capture = Capture(tmp_path / "S", model, UNEVEN, frames=3)
    assert asked == [False]
    assert not capture.retried()


def test_several_cameras_expose_each_step_together(tmp_path: Path, asked: list[bool]) -> None:
    capture = Capture(tmp_path / "S", "sony-a7m4", cameras=2, frames=1)
    assert asked == []
    assert all(
        shot.trigger_delay is not None and shot.trigger_delay < 0.01 for shot in capture.shots.values()
    )
    assert all(shot.skew is None for shot in capture.shots.values())  # no body stamps its frames


@pytest.mark.parametrize("model", MAKES)
def test_frames_exposed_otherwise_are_taken_again_and_the_bracket_no_more(
    tmp_path: Path, asked: list[bool], model: str
) -> None:
    """The body exposes twice as long as it should, and its files say so."""
    operation, nth = PRESS[model]
    off = Fault(Kind.EXPOSURE_OFF, operation=operation, nth=nth, share=1.0)
    capture = Capture(tmp_path / "S", model, TWO_STOPS, [off])
    assert asked == [True]
    assert capture.retried() == {(0, 0), (0, 1), (0, 2)}


def test_of_a_bracket_a_stop_off_those_frames_count_that_state_what_is_wanted(
    tmp_path: Path, asked: list[bool]
) -> None:
    operation, nth = PRESS["canon-eos-6d"]
    off = Fault(Kind.EXPOSURE_OFF, operation=operation, nth=nth, share=1.0)
    capture = Capture(tmp_path / "S", "canon-eos-6d", STOPS[1:], [off])
    assert asked == [True] * 2
    assert not capture.retried()


def test_six_exposures_are_two_brackets_of_three(tmp_path: Path, asked: list[bool]) -> None:
    capture = Capture(tmp_path / "S", "canon-eos-6d", (*STOPS, 1 / 30, 1 / 15), frames=1)
    assert asked == [True] * 2
    assert not capture.retried()


@pytest.mark.parametrize("model", MAKES)
@pytest.mark.parametrize("kind", [Kind.UNPLUG, Kind.STALL])
def test_a_bracket_that_breaks_off_is_completed_and_what_came_is_kept(
    tmp_path: Path, asked: list[bool], model: str, kind: Kind
) -> None:
    """A plug that is pulled ends a bracket, after its first frame, the middle one; a stall is got over."""
    fault = Fault(kind, operation=FETCH[model], nth=2, seconds=0.2, count=100)
    capture = Capture(tmp_path / "S", model, STOPS[1:], [fault])
    assert asked == [kind is Kind.STALL, True]
    assert capture.retried() == (set() if kind is Kind.STALL else {(0, 0), (0, 2)})


def test_a_body_that_keeps_its_drive_mode_shoots_one_by_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, asked: list[bool]
) -> None:
    as_told = SimulatedProperties.set

    def stubborn(self: SimulatedProperties, code: int, data: bytes) -> ResponseCode:
        return ResponseCode.OK if code == PropertyCode.STILL_CAPTURE_MODE else as_told(self, code, data)

    monkeypatch.setattr(SimulatedProperties, "set", stubborn)
    capture = Capture(tmp_path / "S", "sony-a7m4")
    assert asked == [False]
    assert not capture.retried()


def test_what_a_frame_lacks_is_resumed_one_by_one(tmp_path: Path, asked: list[bool]) -> None:
    capture = Capture(tmp_path / "S", "sony-a7m4")
    index = capture.session.folder / "shots.jsonl"
    lines = index.read_bytes().splitlines(keepends=True)
    index.write_bytes(b"".join(lines[:6]))
    asked.clear()
    capture.shoot()
    assert (capture.result.taken, capture.result.earlier) == (2, 6)
    assert asked == []
    index.write_bytes(b"".join(lines[:4]))
    capture.shoot()
    assert (capture.result.taken, capture.result.earlier) == (4, 4)
    assert asked == [True]


def test_a_disk_that_fills_up_within_a_bracket_ends_it_and_another_run_completes_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, asked: list[bool]
) -> None:
    usual, files = store.write_pieces, list[str]()

    def write(path: Path, pieces: Sequence[bytes]) -> None:
        if path.parent.name == "0001":
            files.append(path.name)
            if len(files) > 1:
                raise StorageError(f"{path}: the disk is full: free some of it.")
        usual(path, pieces)

    monkeypatch.setattr(store, "write_pieces", write)
    capture = Capture(tmp_path / "S", "sony-a7m4", complete=False)
    assert capture.result.taken == 5
    assert all("the disk is full" in why for why in capture.result.missing)
    monkeypatch.setattr(store, "write_pieces", usual)
    capture.shoot()
    assert (capture.result.taken, capture.result.earlier) == (3, 5)
    assert asked[0]
    assert len(asked) == 2


def test_a_camera_with_a_card_is_still_emptied_while_it_exposes_the_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usual, handles = PtpCamera.keep, list[object]()

    def keep(self: PtpCamera) -> object:
        handles.append(usual(self))
        return handles[-1]

    monkeypatch.setattr(PtpCamera, "keep", keep)
    Capture(tmp_path / "S", "generic")
    assert len(handles) == 2 * (len(STOPS) - 1)

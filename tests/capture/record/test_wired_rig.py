"""Rigs that are triggered by a wire: what one listener lacks is taken with the leader exposing along."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from capture.bracket.single_exposure import expose
from capture.record.recorder import record
from drivers.sim.faults import Fault, FaultPlan, Kind
from drivers.sim.genicam.lines import Wire
from drivers.sim.rigs import simulate
from drivers.sim.u3v.device import U3vDevice
from drivers.sim.usb.bus import VirtualBus
from drivers.sim.usb.virtual_clock import VirtualClock
from drivers.u3v import U3vCamera
from imaging.errors import CameraError
from imaging.optics.exposure import Exposure
from imaging.session.records import PlanRecord, SessionRecord
from imaging.session.session import Session
from tests.capture.conftest import WHEN
from tests.trees import tree

BRACKET = tuple(Exposure(time=time, iso=100) for time in (1 / 1000, 1 / 60, 1 / 4))


class WiredRig:
    """Three cameras, cam1 the leader; its Line1 ends at Line0 of the others. A new bus every time, as every
    run has one; `folder` holds the session."""

    def __init__(
        self, folder: Path, faults: Sequence[Fault] = (), frames: int = 1, exposures: int = 3
    ) -> None:
        self.rig = simulate("toy", 5, cameras=3, positions=frames, samples=1)
        self.clock = VirtualClock()
        bus, wire = VirtualBus(self.clock), Wire(self.clock, seed=5)
        plan = FaultPlan(self.clock, faults)
        self.devices = [U3vDevice(camera, self.clock, plan) for camera in self.rig.devices]
        for index, device in enumerate(self.devices):
            bus.plug(device)
            wire.connect(device, 1 if index == 1 else 0)
        drivers = [U3vCamera(device.serial, bus, self.clock) for device in self.devices]
        for index, driver in enumerate(drivers):
            if index == 1:
                driver.drive("Line1")
            else:
                driver.listen("Line0")
        records = self.rig.records()
        self.cameras = {one.name: driver for one, driver in zip(records, drivers, strict=True)}
        self.plan = PlanRecord(
            plan="scene",
            kind="scene",
            created=WHEN,
            bracket=BRACKET[:exposures],
            frames=tuple(range(frames)),
            cameras=tuple(self.cameras),
            reason="wires",
        )
        if (folder / "session.json").exists():
            self.session = Session.open(folder)
        else:
            record = SessionRecord(name="wired", created=WHEN, origin="RIG.toml", cameras=records)
            self.session = Session.create(folder, record)
            self.session.append_plan(self.plan)

    def shoot(self, leader: str | None = "cam1"):
        return record(
            self.session,
            self.plan,
            self.cameras,
            clock=self.clock,
            move_to=self.rig.move_to,
            leader=leader,
        )

    def files(self) -> dict[str, bytes]:
        return tree(self.session.folder / "raw", "*.dng")

    def serial(self, name: str) -> str:
        return self.cameras[name].serial


@pytest.fixture
def wired(tmp_path: Path) -> Callable[..., WiredRig]:
    return lambda name="session", *faults, **options: WiredRig(tmp_path / name, faults, **options)


def lost(serial: str, *places: int) -> list[Fault]:
    """The device sends nothing for its frames of those numbers."""
    return [Fault(Kind.TIMEOUT, serial, "Frame", nth) for nth in places]


def others(rig: WiredRig, *names: str) -> dict[str, bytes]:
    """All files but those: a frame that is taken again has noise of its own."""
    return {name: data for name, data in rig.files().items() if name not in names}


def test_a_dropped_frame_of_a_listener_is_taken_again_with_the_leader(wired) -> None:
    whole = wired("whole")
    assert whole.shoot().missing == ()
    rig = wired("dropped", *lost(whole.serial("cam2"), 2))
    result = rig.shoot()
    assert (result.taken, result.missing) == (9, ())
    assert others(rig, "0000/cam2_1.dng") == others(whole, "0000/cam2_1.dng")
    shots = {(shot.camera, shot.step): shot for shot in rig.session.shots()}
    assert len(rig.session.shots()) == 9
    assert [key for key, shot in shots.items() if shot.retries] == [("cam2", 1)]
    # The leader exposed once more than it has shots; who was not asked to expose did not.
    assert [len(device.opened) for device in rig.devices] == [3, 4, 4]
    assert max(shot.skew for key, shot in shots.items() if key != ("cam2", 1)) < 100e-6
    opened = rig.devices[2].opened
    assert shots["cam2", 1].skew == pytest.approx(opened[3] - opened[1], abs=100e-6)
    assert abs(opened[3] - rig.devices[1].opened[3]) < 100e-6


def test_without_a_leader_to_expose_along_nothing_comes(wired) -> None:
    """Show the result of the two tests beside this one if the leader stayed away."""
    rig = wired("dropped", *lost(wired().serial("cam2"), 2))
    result = rig.shoot(leader=None)
    assert [sentence.split(": ")[0] for sentence in result.missing] == ["cam2, frame 0, step 1"]
    assert "got no pulse on Line0" in result.missing[0]


def test_resume_completes_a_listener_and_leaves_the_leader_s_files_alone(wired) -> None:
    rig = wired()
    rig.shoot()
    whole = rig.files()
    index = rig.session.folder / "shots.jsonl"
    lines = index.read_bytes().splitlines(keepends=True)
    lacking = next(n for n, shot in enumerate(rig.session.shots()) if (shot.camera, shot.step) == ("cam2", 1))
    index.write_bytes(b"".join(lines[:lacking] + lines[lacking + 1 :]))
    (rig.session.folder / "raw/0000/cam2_1.dng").unlink()
    earlier = index.read_bytes()
    before = (rig.session.folder / "raw/0000/cam1_1.dng").stat()
    again = wired()
    result = again.shoot()
    assert (result.earlier, result.taken, result.missing) == (8, 1, ())
    assert again.files() == whole
    assert (rig.session.folder / "raw/0000/cam1_1.dng").stat() == before
    assert index.read_bytes().startswith(earlier)
    added = again.session.shots()[8:]
    assert [(shot.camera, shot.step, shot.skew) for shot in added] == [("cam2", 1, None)]
    assert [len(device.opened) for device in again.devices] == [0, 1, 1]


def test_a_listener_is_never_armed_for_an_edge_of_another_step(wired) -> None:
    """The leader loses one step and a listener another: each is taken again, none at the other's edge."""
    whole = wired("whole", frames=2)
    whole.shoot()
    rig = wired("both", *lost(whole.serial("cam1"), 1), *lost(whole.serial("cam2"), 3), frames=2)
    arm = rig.cameras["cam1"].arm

    def slowly() -> None:
        rig.clock.sleep(0.5)
        arm()

    rig.cameras["cam1"].arm = slowly
    result = rig.shoot()
    assert (result.taken, result.missing, result.problems) == (18, (), ())
    again = ("0000/cam1_0.dng", "0000/cam2_2.dng")
    assert others(rig, *again) == others(whole, *again)
    # Of the first frame the leader takes its step again alone, then the listener's with it.
    assert [len(device.opened) for device in rig.devices] == [6, 8, 7]
    leader, listener = rig.devices[1].opened, rig.devices[2].opened
    assert np.abs(np.subtract(listener, [*leader[:3], *leader[4:]])).max() < 100e-6


def test_listeners_do_not_wait_for_an_edge_when_the_leader_is_not_ready(wired) -> None:
    rig = wired(exposures=1)
    ready, calls = rig.cameras["cam1"].arm, []

    def refuses_once() -> None:
        calls.append(rig.clock.now())
        if len(calls) == 1:
            raise CameraError("cam1 is busy.")
        ready()

    rig.cameras["cam1"].arm = refuses_once
    assert rig.shoot().missing == ()
    assert calls[1] - calls[0] < 1.0
    assert {shot.retries for shot in rig.session.shots()} == {1}
    assert max(shot.skew for shot in rig.session.shots()) < 100e-6


def test_a_leader_that_hangs_is_waited_for_again(wired) -> None:
    rig = wired(exposures=1)
    ready, calls = rig.cameras["cam1"].set_exposure, []

    def hangs_once(exposure: Exposure) -> Exposure:
        calls.append(rig.clock.now())
        if len(calls) == 1:
            rig.clock.sleep(50.0)
        return ready(exposure)

    rig.cameras["cam1"].set_exposure = hangs_once
    assert rig.shoot().missing == ()
    assert len(calls) == 2
    assert {shot.retries for shot in rig.session.shots()} == {1}


def test_the_meter_gets_the_frame_that_a_listener_dropped(wired) -> None:
    rig = wired("dropped", *lost(wired().serial("cam2"), 1))
    taken, errors = expose(rig.cameras, BRACKET[1])
    assert errors == {}
    assert {name: one.retries for name, one in taken.items()} == {"cam0": 0, "cam1": 0, "cam2": 1}


def test_without_a_leader_a_retry_waits_for_the_next_edge(wired) -> None:
    """All listen; the edges come from elsewhere, 3 s apart."""
    rig = wired("edges", *lost(wired().serial("cam2"), 1), exposures=2)
    rig.cameras["cam1"].close()
    del rig.cameras["cam1"]
    rig.plan = rig.plan.model_copy(update={"cameras": ("cam0", "cam2")})

    def edge() -> None:
        for device in (rig.devices[0], rig.devices[2]):
            device.line(0, True)
            device.line(0, False)
        rig.clock.call_later(3.0, edge)

    rig.clock.call_later(3.0, edge)
    result = rig.shoot(leader=None)
    assert (result.taken, result.missing) == (4, ())
    assert [(s.camera, s.step) for s in rig.session.shots() if s.retries] == [("cam2", 0)]


def test_a_cut_wire_is_told_by_every_attempt(wired) -> None:
    rig = wired(exposures=1)
    rig.devices[2].line = lambda number, rising: None
    result = rig.shoot()
    assert len(result.missing) == 1
    assert "check the cable" in result.missing[0]

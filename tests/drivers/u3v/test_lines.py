"""Several cameras on one trigger wire: all expose with the leader, or say which cable to look at."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from capture.bracket.single_exposure import expose
from capture.record.recorder import record
from drivers.errors import CameraRefused, CameraTimeout
from drivers.sim.camera.camera import SimulatedCamera
from drivers.sim.genicam.feature_registers import Feature
from drivers.sim.genicam.lines import Wire
from drivers.sim.rigs import simulate
from drivers.sim.u3v.device import U3vDevice
from drivers.sim.usb.bus import VirtualBus
from drivers.sim.usb.virtual_clock import VirtualClock
from drivers.u3v import U3vCamera
from imaging.files.raw import read_raw
from imaging.optics.exposure import Exposure
from imaging.sensor.mosaic import RawMosaic
from imaging.session.records import CameraRecord, PlanRecord, SessionRecord
from imaging.session.session import Session
from tests.drivers.shots import raw_shot, together

LABEL = Exposure(time=1 / 60, iso=200)
BRACKET = [Exposure(time=time, iso=100) for time in (1 / 1000, 1 / 60, 1 / 4)]


@dataclass
class Trio:
    """Three cameras; Line1 of the first is soldered to Line0 of the others unless `cut` says otherwise."""

    clock: VirtualClock
    bus: VirtualBus
    devices: list[U3vDevice]
    cameras: list[U3vCamera]
    twins: list[SimulatedCamera]

    def wire_up(self) -> None:
        """Tell the drivers what is soldered."""
        self.cameras[0].drive("Line1")
        for camera in self.cameras[1:]:
            camera.listen("Line0")

    def shoot(self, exposure: Exposure) -> list[RawMosaic]:
        return together(self.cameras, exposure)

    def right(self, frames: Sequence[RawMosaic], exposure: Exposure) -> bool:
        """Return whether they equal the shots of cameras without USB."""
        for frame, twin in zip(frames, self.twins, strict=True):
            if not np.array_equal(frame.pixels, raw_shot(twin, exposure).pixels):
                return False
        return True

    def spread(self) -> float:
        """True seconds between the first and the last shutter of the latest shot."""
        moments = [device.opened[-1] for device in self.devices]
        return max(moments) - min(moments)


def make_trio(cut: Sequence[int] = ()) -> Trio:
    rig = simulate("toy", cameras=3, seed=5)
    views = [np.asarray(rig.radiance(index, 0)) for index in range(3)]
    clock = VirtualClock()
    bus, wire = VirtualBus(clock), Wire(clock, seed=5)

    def make(index: int) -> SimulatedCamera:
        return SimulatedCamera(rig.bodies[index], lambda frame: views[index])

    devices = [U3vDevice(make(index), clock) for index in range(3)]
    for index, device in enumerate(devices):
        bus.plug(device)
        if index not in cut:
            wire.connect(device, 0 if index else 1)
    cameras = [U3vCamera(device.serial, bus, clock) for device in devices]
    return Trio(clock, bus, devices, cameras, [make(index) for index in range(3)])


def measured(frames: Sequence[RawMosaic]) -> float:
    """Seconds between the first and the last shutter, as the cameras tell."""
    moments = [frame.metadata.opened for frame in frames]
    known = [moment for moment in moments if moment is not None]
    assert len(known) == len(frames)
    return max(known) - min(known)


def test_a_bracket_of_a_wired_rig_opens_together_and_of_an_unwired_one_does_not() -> None:
    trio = make_trio()
    spreads: dict[str, list[float]] = {"software": [], "line": []}
    for way in spreads:
        if way == "line":
            trio.wire_up()
        for exposure in BRACKET:
            frames = trio.shoot(exposure)
            assert trio.right(frames, exposure)
            assert all(frame.metadata.exposure is not None for frame in frames)
            assert abs(measured(frames) - trio.spread()) < 50e-6
            spreads[way].append(measured(frames))
    assert [len(device.opened) for device in trio.devices] == [6, 6, 6]
    assert 0 < max(spreads["line"]) < 100e-6 < 300e-6 < min(spreads["software"])


def test_the_recorder_s_own_order_suits_a_leader_wherever_it_stands() -> None:
    for order in ((0, 1, 2), (2, 1, 0)):
        trio = make_trio()
        trio.wire_up()
        named = {f"cam{index}": trio.cameras[index] for index in order}
        for exposure in BRACKET:
            taken, errors = expose(named, exposure)
            assert not errors
            frames = [taken[f"cam{index}"].frame for index in range(3)]
            mosaics = [frame for frame in frames if isinstance(frame, RawMosaic)]
            assert trio.right(mosaics, exposure)
            assert measured(mosaics) < 100e-6
            assert {one.retries for one in taken.values()} == {0}


def test_a_cut_cable_is_named_and_the_others_deliver() -> None:
    trio = make_trio(cut=(2,))
    trio.wire_up()
    taken, errors = expose({str(index): camera for index, camera in enumerate(trio.cameras)}, LABEL)
    assert set(taken) == {"0", "1"}
    assert set(errors) == {"2"}
    assert isinstance(errors["2"], CameraTimeout)
    message = str(errors["2"])
    assert f"camera {trio.devices[2].serial} got no pulse on Line0 within 5.02 s" in message
    assert "check the cable" in message


def test_a_leader_that_does_not_drive_its_line_gives_no_pulse() -> None:
    trio = make_trio()
    trio.cameras[1].listen("Line0")
    for camera in trio.cameras[:2]:
        camera.set_exposure(LABEL)
        camera.arm()
    for camera in trio.cameras[:2]:
        camera.trigger()
    trio.cameras[0].collect()
    with pytest.raises(CameraTimeout, match="drives its own end"):
        trio.cameras[1].collect()


def test_wiring_outlives_being_unplugged() -> None:
    trio = make_trio()
    trio.wire_up()
    trio.shoot(LABEL)
    for device in trio.devices:
        port = device._port
        assert port is not None
        port.unplug(replug_after=1.0)
    trio.clock.sleep(2.0)
    frames = trio.shoot(LABEL)
    assert measured(frames) < 100e-6
    assert trio.spread() < 100e-6


def test_a_camera_that_another_run_left_listening_takes_the_software_trigger() -> None:
    trio = make_trio()
    first, device = trio.cameras[0], trio.devices[0]
    first.listen("Line2")
    assert first._session is not None
    first._session.nodes.set("TriggerActivation", "FallingEdge")
    first.close()
    again = U3vCamera(first.serial, trio.bus, trio.clock)
    again.set_exposure(LABEL)
    again.arm()
    again.trigger()
    assert again.collect().metadata.exposure == Exposure(time=2.0**-6, iso=200)
    # And one that was left to falling edges listens to rising ones.
    again.listen("Line2")
    again.arm()
    trio.clock.call_later(0.1, lambda: device.line(2, rising=False))
    trio.clock.call_later(0.2, lambda: device.line(2, rising=True))
    began = again.trigger()
    opened = again.collect().metadata.opened
    assert opened is not None
    assert opened - began == pytest.approx(0.2, abs=1e-3)


def test_an_output_takes_no_trigger_and_an_input_drives_nothing() -> None:
    trio = make_trio()
    leader, device = trio.cameras[0], trio.devices[0]
    leader.drive("Line1")
    assert device._memory.get(Feature.LINE_CONTROL, 1) == 0x11
    leader.listen("Line2")
    with pytest.raises(CameraRefused, match=r"listens to Line2: have it drive another"):
        leader.drive("Line2")
    with pytest.raises(CameraRefused, match=r"listens to Line1: have it drive another"):
        leader.listen("Line1")
    # Refused, it stays as it was.
    leader.set_exposure(LABEL)
    assert device._memory.get(Feature.LINE_CONTROL, 1) == 0x11
    assert device._memory.get(Feature.TRIGGER_CONTROL) == 0x31


def test_a_line_that_is_not_there_is_refused_with_those_that_are() -> None:
    trio = make_trio()
    camera = trio.cameras[0]
    name = f"camera {camera.serial}"
    with pytest.raises(CameraRefused) as refused:
        camera.listen("Line7")
    assert str(refused.value) == (
        f"{name} cannot be triggered by Line7: choose among its lines Line0, Line1, Line2."
    )
    with pytest.raises(CameraRefused) as refused:
        camera.drive("Line0")
    assert str(refused.value) == (
        f"{name} cannot show on Line0 that it exposes: choose among its lines Line1, Line2."
    )
    # The software trigger is still there.
    assert trio.right(trio.shoot(LABEL), LABEL)


def test_a_recorded_bracket_tells_its_skew(tmp_path: Path) -> None:
    trio = make_trio()
    trio.wire_up()
    named = {f"cam{index}": camera for index, camera in enumerate(trio.cameras)}
    known = [(name, camera.identify()) for name, camera in named.items()]
    session = Session.create(
        tmp_path / "session",
        SessionRecord(
            name="wired",
            created=datetime(2026, 3, 1),
            origin="RIG.toml",
            cameras=tuple(
                CameraRecord(
                    name=name,
                    serial=identity.serial,
                    make=identity.make,
                    model=identity.model,
                    kind=identity.kind,
                )
                for name, identity in known
            ),
        ),
    )
    plan = PlanRecord(
        plan="scene",
        kind="scene",
        created=datetime(2026, 3, 1),
        bracket=tuple(BRACKET),
        frames=(0,),
        cameras=tuple(named),
        reason="wires",
    )
    session.append_plan(plan)
    result = record(session, plan, named, clock=trio.clock)
    assert (result.taken, result.missing) == (9, ())
    shots = session.shots()
    for step, exposure in enumerate(BRACKET):
        of_step = sorted((shot for shot in shots if shot.step == step), key=lambda shot: shot.camera)
        assert trio.right([read_raw(session.file(shot)) for shot in of_step], exposure)
        skews = np.array([shot.skew for shot in of_step], float)
        opened = np.array([device.opened[step] for device in trio.devices])
        assert np.abs(skews - (opened - opened.min())).max() < 100e-6
        assert skews.max() < 100e-6
    assert [shot.retries for shot in shots] == [0] * 9

"""RIG.toml to session, through the drivers, on a simulated bus."""

import json
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from capture.bracket.goals import BracketGoals
from capture.capture_rig import capture_rig
from capture.connected_rig import connected_source
from capture.record.capture_result import CaptureResult
from capture.record.shooting import Rehearsal, rehearse
from capture.request import RigRequest
from capture.rigfile.rigfile import read_rig_file
from capture.rigfile.template import rig_file_text
from drivers.discovery import ask_all
from drivers.ptp.protocol.codes import Operation
from drivers.sim.bus_rig import BusRig
from drivers.sim.faults import Fault, FaultPlan, Kind
from drivers.sim.genicam.lines import Wire
from drivers.sim.ptp.usb_device import PtpDevice
from drivers.sim.rigs import SimulatedRig, simulate
from drivers.sim.u3v.device import U3vDevice
from drivers.sim.usb.bus import Holder, VirtualBus
from drivers.sim.usb.virtual_clock import VirtualClock
from imaging.errors import CaptureError, InputError
from imaging.optics.exposure import Exposure
from imaging.session.session import Session

STOPS = 'exposures = [-4, 0]\ntime = "1/60"'


@dataclass
class Place:
    """A rig on its bus, its file, and what was said; every capture has a bus of its own, as every run has."""

    folder: Path
    seed: int = 3
    said: list[str] = field(default_factory=list)
    prepare: Callable[[BusRig], None] = lambda bus: None

    @property
    def file(self) -> Path:
        return self.folder / "RIG.toml"

    @property
    def out(self) -> Path:
        return self.folder / "S"

    def bus(self) -> tuple[SimulatedRig, BusRig]:
        rig = simulate("toy", self.seed, samples=1)
        bus = BusRig(rig)
        self.prepare(bus)
        return rig, bus

    def write(self, *changes: tuple[str, str]) -> None:
        """The file that rig init writes, with changes."""
        _, bus = self.bus()
        text = rig_file_text(list(ask_all(bus.backend, bus.clock)))
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        self.file.write_text(text)

    def shoot(self, out: Path | None = None, **options) -> CaptureResult:
        rig, bus = self.bus()
        try:
            return capture_rig(
                read_rig_file(self.file),
                out or self.out,
                operator=rig,
                positions=rig.frames,
                backend=bus.backend,
                clock=bus.clock,
                on_message=self.said.append,
                **options,
            )
        finally:
            assert bus.backend.open_handles == 0

    def rehearse(self, name: str = "S") -> Rehearsal:
        rig, bus = self.bus()
        request = RigRequest(operator=rig, positions=rig.frames, backend=bus.backend, clock=bus.clock)
        with connected_source(read_rig_file(self.file), request) as source:
            return rehearse(source, self.folder / name, request)


@pytest.fixture
def place(tmp_path: Path) -> Place:
    return Place(tmp_path)


@pytest.fixture
def given(place: Place) -> Place:
    """A rig file with a bracket that needs no meter."""
    place.write(('exposures = "auto"', STOPS), ("frames = 1 ", "frames = 2 "))
    return place


def test_what_rig_init_writes_shoots_what_it_says(place: Place) -> None:
    place.write(("snr = 20.0", "snr = 12.0"), ('# slowest = "1/4"', 'slowest = "1/4"'))
    result = place.shoot()
    session = Session.open(place.out)
    assert (session.record.origin, session.record.seed) == ("RIG.toml", None)
    assert [(c.name, c.serial, c.rig) for c in session.record.cameras] == [
        ("cam0", "SIM-RAW-001", "rig"),
        ("cam1", "SIM-RAW-002", "rig"),
    ]
    (plan,) = session.plans()
    assert plan.asked == "auto, snr 12, slowest 0.25"
    assert max(exposure.time for exposure in plan.bracket) <= 1 / 4
    assert {exposure.f_number for exposure in plan.bracket} == {8.0}
    assert (result.taken, result.planned, result.missing) == (2 * len(plan.bracket),) * 2 + ((),)
    assert not (place.out / "truth").exists()
    assert place.said == []


def test_a_camera_that_cannot_be_triggered_is_refused_by_name(given: Place) -> None:
    def take_away(bus: BusRig) -> None:
        device = bus.backend.port("SIM-RAW-001").device
        assert isinstance(device, PtpDevice)
        del device.responder._handlers[Operation.INITIATE_CAPTURE]

    given.prepare = take_away
    with pytest.raises(
        CaptureError,
        match=r"RIG\.toml, line \d+: cam0 with the serial number 'SIM-RAW-001' cannot shoot for rig "
        r"\(it takes no pictures on command\): take it out of the file\.",
    ):
        given.shoot()
    assert not given.out.exists()


def test_the_command_line_goes_before_the_file(given: Place) -> None:
    given.shoot(frames=1, bracket=(-1.0, 1.0))
    (plan,) = Session.open(given.out).plans()
    assert [exposure.time for exposure in plan.bracket] == [1 / 125, 1 / 30]
    assert plan.frames == (0,)
    given.shoot(given.folder / "auto", frames=1, bracket=BracketGoals(snr=10.0, slowest=1 / 8))
    (plan,) = Session.open(given.folder / "auto").plans()
    assert plan.asked == "auto, snr 10, slowest 0.125"


def test_the_middle_of_stops_is_metered_where_the_file_does_not_give_it(place: Place) -> None:
    place.write(('exposures = "auto"', "exposures = [-2, 0, 2]"))
    place.shoot()
    (plan,) = Session.open(place.out).plans()
    low, middle, high = plan.bracket
    assert (middle.time / low.time, high.time / middle.time) == pytest.approx((4, 4), rel=0.07)
    metering = place.rehearse("T").metering
    assert metering is not None

    def lacks(exposure: Exposure) -> tuple[float, float]:
        """Stops by which the bright end clips, and by which the dark end is too dark for 10 dB."""
        pairs = [
            (t.bright / t.noise.brightest(exposure), t.noise.darkest(10.0, exposure) / t.dark)
            for t in metering.targets
        ]
        return math.log2(max(one for one, _ in pairs)), math.log2(max(one for _, one in pairs))

    # The middle of a scene of 17 stops shows neither end.
    bright, dark = lacks(middle)
    assert bright == pytest.approx(dark, abs=1 / 3)
    assert bright > 2
    assert lacks(low)[0] < lacks(low)[1]
    assert lacks(high)[0] > lacks(high)[1]


def test_the_iso_of_stops_is_that_of_the_file_where_their_middle_is_metered(place: Place) -> None:
    """At ISO 100 the middle is 1/8 s; at three stops more the bright end leaves less time."""
    place.write(('exposures = "auto"', "exposures = [-2, 0]"), ("# iso = 100", "iso = 800"))
    place.shoot(frames=1)
    (plan,) = Session.open(place.out).plans()
    low, middle = plan.bracket
    assert (low.iso, middle.iso) == (800, 800)
    assert 1 / 64 < middle.time < 1 / 16


ISO = (("# iso = 100", "iso = 7"), "ISO 7, which cam0 lacks: choose one from 100 to 1600")
IRIS = (("f_number = 8 ", "f_number = 45 "), "f/45, which cam0 lacks: choose one from f/2.8 to f/16")


@pytest.mark.parametrize(
    ("bracket", "change", "words"),
    [("exposures = [-2, 0]", *ISO), (STOPS, *ISO), (STOPS, *IRIS), ('exposures = "auto"', *IRIS)],
)
def test_a_setting_that_a_camera_lacks_is_refused(
    place: Place, bracket: str, change: tuple[str, str], words: str
) -> None:
    place.write(('exposures = "auto"', bracket), change)
    for work in (place.shoot, place.rehearse):
        with pytest.raises(InputError, match=rf"RIG\.toml asks for {words}"):
            work()
    assert not place.out.exists()


def test_resume_takes_what_is_missing_and_gives_the_same_bytes(given: Place) -> None:
    given.shoot()
    whole = {path.name: path.read_bytes() for path in sorted(given.out.rglob("*.dng"))}
    index = given.out / "shots.jsonl"
    lines = index.read_bytes().splitlines(keepends=True)
    index.write_bytes(b"".join(lines[:3]))
    for line in lines[3:]:
        (given.out / json.loads(line)["file"]).unlink()
    result = given.shoot(resume=True)
    assert (result.earlier, result.taken) == (3, 5)
    assert {path.name: path.read_bytes() for path in sorted(given.out.rglob("*.dng"))} == whole
    assert given.said == []


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            ('name = "cam0"', 'name = "left"'),
            "with cam0 as SIM-RAW-001 .raw, rig rig., and RIG.toml now has no",
        ),
        (
            ('"SIM-RAW-001"\nrig = "rig"', '"SIM-RAW-001"\nrig = "two"'),
            r"now has cam0 as SIM-RAW-001 \(raw, rig two\)",
        ),
    ],
)
def test_resume_with_other_cameras_is_refused(given: Place, change: tuple[str, str], words: str) -> None:
    given.shoot(frames=1)
    given.write(change, ('exposures = "auto"', STOPS))
    with pytest.raises(InputError, match=words):
        given.shoot(resume=True)
    with pytest.raises(InputError, match=words):
        given.shoot(kind="dark")


def test_resume_goes_on_as_planned_and_says_so_where_the_file_has_changed(given: Place) -> None:
    given.shoot(frames=1)
    given.write(('exposures = "auto"', STOPS.replace("-4", "-3")))
    assert given.shoot(resume=True).taken == 0
    assert given.said[0].endswith("RIG.toml now has stops -3, 0.")
    assert "as planned, with stops -4, 0 (1/1000 s f/8 ISO 100, 1/60 s f/8 ISO 100)" in given.said[0]
    for options in ({"bracket": BracketGoals()}, {"bracket": (-3.0, 0.0)}, {"frames": 2}):
        with pytest.raises(InputError, match="was planned with"):
            given.shoot(resume=True, **options)


def test_a_camera_that_is_not_connected_is_named_with_its_line(given: Place) -> None:
    given.prepare = lambda bus: bus.backend.unplug("SIM-RAW-002")
    with pytest.raises(CaptureError) as caught:
        given.shoot()
    line = given.file.read_text().splitlines().index('serial = "SIM-RAW-002"') + 1
    assert f"RIG.toml, line {line}: cam1 with the serial number 'SIM-RAW-002' is not among the" in str(
        caught.value
    )
    assert "connected cameras (SIM-RAW-001): connect it, or correct" in str(caught.value)
    assert not given.out.exists()


def test_a_camera_that_another_program_holds_is_told(given: Place) -> None:
    given.prepare = lambda bus: bus.backend.hold("SIM-RAW-002", Holder.OTHER_PROGRAM)
    with pytest.raises(CaptureError, match=r"cameras \(SIM-RAW-001; .*held by another program"):
        given.shoot()


def test_a_camera_that_the_file_does_not_name_is_left_alone_and_told(given: Place) -> None:
    text = given.file.read_text()
    given.file.write_text(text[: text.rindex("[[camera]]")])
    assert given.shoot(frames=1).planned == 2
    (said,) = given.said
    assert said.startswith("hdr-rig Simulated PTP SIM-RAW-002 is connected and not in ")


def test_a_camera_without_lines_cannot_be_triggered_by_hardware(given: Place) -> None:
    given.write(('mode = "software"', 'mode = "hardware"'), ("# line =", "line ="))
    line = given.file.read_text().splitlines().index("[[camera]]  # hdr-rig Simulated PTP, PTP") + 1
    with pytest.raises(InputError, match=f"line {line}: cam0 has no lines for a hardware trigger"):
        given.shoot()
    assert not given.out.exists()


def test_the_rehearsal_is_what_is_then_shot(given: Place) -> None:
    done = given.rehearse()
    assert not given.out.exists()
    given.shoot()
    (plan,) = Session.open(given.out).plans()
    assert (done.record.bracket, done.record.frames) == (plan.bracket, plan.frames)
    assert done.size == (64, 48)
    assert done.metering is not None


def test_a_hardware_trigger_opens_all_shutters_with_the_leader(tmp_path: Path) -> None:
    """Line1 of cam0 is soldered to Line0 of cam1, as the file says; without that wire cam1 sees no edge.

    cam1 loses a frame, which it gets only if the leader of the file exposes along once more.
    """
    for soldered in (True, False):
        rig = simulate("toy", 3, samples=1)
        clock = VirtualClock()
        bus, wire = VirtualBus(clock), Wire(clock)
        lost = Fault(Kind.TIMEOUT, rig.devices[1].body.serial, "Frame", nth=2)
        devices = [U3vDevice(camera, clock, FaultPlan(clock, [lost])) for camera in rig.devices]
        for number, device in enumerate(devices):
            bus.plug(device)
            if soldered:
                wire.connect(device, 1 - number)
        text = rig_file_text(list(ask_all(bus, clock)))
        for old, new in (
            ('exposures = "auto"', STOPS),
            ('mode = "software"', 'mode = "hardware"'),
            ("# line =", "line ="),
            ("# leader =", "leader ="),
            ("# output =", "output ="),
        ):
            assert old in text
            text = text.replace(old, new)
        (tmp_path / "RIG.toml").write_text(text)
        file = read_rig_file(tmp_path / "RIG.toml")
        result = capture_rig(file, tmp_path / f"S{soldered}", operator=rig, backend=bus, clock=clock)
        if soldered:
            assert (result.taken, result.missing) == (4, ())
            assert [len(device.opened) for device in devices] == [3, 3]
            opened = np.array([device.opened[-1] for device in devices])
            assert np.ptp(opened) < 100e-6
        else:
            assert {one.split(",")[0] for one in result.missing} == {"cam1"}


def test_shutters_further_apart_than_the_file_tolerates_are_told(given: Place) -> None:
    """A camera that is busy for 50 ms when it is triggered."""

    def dawdle(bus: BusRig) -> None:
        bus.plan.faults = (Fault(Kind.BUSY, "SIM-RAW-002", "INITIATE_CAPTURE", nth=1, seconds=0.05),)

    for tolerance, warned in (("0.01", True), ("1.0", False)):
        given.prepare = lambda bus: None
        given.write(('exposures = "auto"', STOPS), ("tolerance = 0.02", f"tolerance = {tolerance}"))
        given.prepare = dawdle
        result = given.shoot(given.folder / tolerance)
        assert Session.open(given.folder / tolerance).plans()[0].tolerance == float(tolerance)
        assert result.missing == ()
        assert bool(result.problems) is warned

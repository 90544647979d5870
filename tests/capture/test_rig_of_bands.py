"""RIG.toml with a filter before each mono camera: the session knows the bands, and merges them."""

from functools import partial
from pathlib import Path

import pytest

from calib.exports.merge_session import merge
from capture.capture_rig import capture_rig
from capture.check.check import check, repair
from capture.rigfile.filters import band_of
from capture.rigfile.rigfile import read_rig_file
from capture.rigfile.template import rig_file_text
from drivers.discovery import ask_all
from drivers.sim.bus_rig import BusRig
from drivers.sim.camera.camera import SimulatedCamera
from drivers.sim.camera.filters import behind
from drivers.sim.ptp.profiles import profile
from drivers.sim.ptp.responder import Responder
from drivers.sim.ptp.usb_device import PtpDevice
from drivers.sim.rigs import SimulatedRig, simulate
from drivers.sim.usb.bus import VirtualBus
from drivers.sim.usb.virtual_clock import VirtualClock
from imaging.choices import Subject
from imaging.errors import InputError
from imaging.files.raw import read_raw
from imaging.sensor.cfa import Cfa
from imaging.session.records import Band
from imaging.session.session import Session

FILTERS = ("650nm, 650, 40", "550nm, 550, 30")
WHEEL = 'filters = ["650nm, 650, 40", "450nm, 450, 40"]'
EXAMPLE = '# band = "650nm, 650, 40"'


def bus() -> tuple[VirtualBus, VirtualClock]:
    """Two mono cameras of the toy rig, each behind its filter."""
    rig, clock = simulate("toy", samples=1), VirtualClock()
    plugged = VirtualBus(clock)
    for index, wave in enumerate((650.0, 550.0)):
        body = behind(rig.bodies[index], Band(name=f"{wave:.0f}nm", wavelength_nm=wave))
        camera = SimulatedCamera(body, partial(rig.radiance, index))
        plugged.plug(PtpDevice(Responder(camera, profile("generic"), clock)))
    return plugged, clock


def write(path: Path, *filters: str | None) -> None:
    """The file that rig init writes, with these filters."""
    text = rig_file_text(list(ask_all(*bus())))
    text = text.replace('exposures = "auto"', 'exposures = [-4, 0]\ntime = "1/60"')
    for line in filters:
        start = text.index(EXAMPLE)
        end = text.index("\n", start)
        text = f"{text[:start]}{'# none' if line is None else f'band = {line!r}'}{text[end:]}"
    path.write_text(text)


def test_a_session_of_cameras_behind_filters_knows_its_bands(tmp_path: Path) -> None:
    write(tmp_path / "RIG.toml", *FILTERS)
    backend, clock = bus()
    result = capture_rig(read_rig_file(tmp_path / "RIG.toml"), tmp_path / "S", backend=backend, clock=clock)
    assert result.missing == ()
    session = Session.open(tmp_path / "S")
    assert session.record.bands == (
        Band(name="550nm", wavelength_nm=550, bandwidth_nm=30),
        Band(name="650nm", wavelength_nm=650, bandwidth_nm=40),
    )
    assert {(shot.camera, shot.band) for shot in session.shots()} == {("cam0", "650nm"), ("cam1", "550nm")}
    assert all(read_raw(session.file(shot)).cfa == Cfa.MONO for shot in session.shots())
    assert check(session.folder).ok
    merge(session, tmp_path / "merged")
    assert len(list((tmp_path / "merged").rglob("*.exr"))) == 2
    index = session.folder / "shots.jsonl"
    index.write_text("".join(index.read_text().splitlines(keepends=True)[:-1]))
    before = {shot.file: shot.band for shot in Session.open(session.folder).shots()}
    repair(session.folder)
    after = {shot.file: shot.band for shot in Session.open(session.folder).shots()}
    assert len(after) == len(before) + 1
    assert before.items() <= after.items()
    assert None not in after.values()


class Turner:
    """Somebody at the rig who turns the wheels, until they leave."""

    def __init__(self, rig: SimulatedRig, leaves_after: int = 1000) -> None:
        self.rig, self.leaves_after, self.turned = rig, leaves_after, list[str]()

    def show(self, kind: Subject) -> None:
        self.rig.show(kind)

    def move_to(self, frame: int) -> None:
        self.rig.move_to(frame)

    def turn_to(self, band: str) -> None:
        if len(self.turned) == self.leaves_after:
            raise InputError("gone home")
        self.turned.append(band)
        self.rig.turn_to(band)


def wheels(path: Path, first: str = WHEEL, second: str = WHEEL, bracket: str = "[-4, 0]") -> None:
    """A rig file of two cameras with filter wheels."""
    write(path)
    text = path.read_text()
    for line in (first, second):
        start = text.index("# filters")
        end = text.index("\n", start)
        text = f"{text[:start]}{line}{text[end:]}"
    path.write_text(text.replace("exposures = [-4, 0]", f"exposures = {bracket}"))


def test_a_wheel_is_turned_at_every_position_and_resumed_where_it_stood(tmp_path: Path) -> None:
    wheels(tmp_path / "RIG.toml")
    sim = simulate("toy-wheel", samples=1)
    bus_rig = BusRig(sim)
    file, arguments = read_rig_file(tmp_path / "RIG.toml"), {"backend": bus_rig.backend, "frames": 2}
    leaving = Turner(sim, leaves_after=3)
    with pytest.raises(InputError, match="gone home"):
        capture_rig(file, tmp_path / "S", clock=bus_rig.clock, operator=leaving, **arguments)
    assert leaving.turned == ["650nm", "450nm", "650nm"]
    assert len(Session.open(tmp_path / "S").shots()) == 12
    bus_rig = BusRig(sim)
    staying = Turner(sim)
    arguments["backend"] = bus_rig.backend
    result = capture_rig(
        file, tmp_path / "S", clock=bus_rig.clock, operator=staying, resume=True, **arguments
    )
    assert (result.missing, result.earlier, result.taken) == ((), 12, 4)
    assert staying.turned == ["450nm"]
    session = Session.open(tmp_path / "S")
    assert {(shot.step, shot.band) for shot in session.shots()} == {
        (0, "650nm"), (1, "650nm"), (2, "450nm"), (3, "450nm"),
    }  # fmt: skip
    assert [band.name for band in session.record.bands] == ["450nm", "650nm"]
    # Each band is the light of its filter: a grey sensor sees blue and red unlike.
    means = {shot.band: read_raw(session.file(shot)).signal().mean() for shot in session.shots()}
    assert means["450nm"] != pytest.approx(means["650nm"], rel=0.05)
    index = session.folder / "shots.jsonl"
    index.write_text("".join(index.read_text().splitlines(keepends=True)[:-3]))
    repair(session.folder)
    assert {shot.file: shot.band for shot in Session.open(session.folder).shots()} == {
        shot.file: shot.band for shot in session.shots()
    }
    wheels(tmp_path / "RIG.toml", WHEEL.replace("450", "470"), WHEEL.replace("450", "470"))
    with pytest.raises(InputError, match=r"through the filters 450nm, 650nm, and RIG\.toml now has 470nm"):
        capture_rig(
            read_rig_file(tmp_path / "RIG.toml"),
            session.folder,
            clock=bus_rig.clock,
            operator=staying,
            resume=True,
            **arguments,
        )


def test_every_band_is_metered_by_itself(tmp_path: Path) -> None:
    """The infrared filter lets a fiftieth through."""
    dim = WHEEL.replace("450", "760")
    wheels(tmp_path / "RIG.toml", dim, dim, bracket='"auto"')
    sim = simulate(
        "toy-wheel", samples=1, wheel=tuple(band_of(line) for line in ("650nm, 650", "760nm, 760"))
    )
    bus_rig, turner = BusRig(sim), Turner(sim)
    file = read_rig_file(tmp_path / "RIG.toml")
    capture_rig(file, tmp_path / "S", operator=turner, backend=bus_rig.backend, clock=bus_rig.clock)
    assert turner.turned == ["650nm", "760nm"] * 2
    (plan,) = Session.open(tmp_path / "S").plans()
    shortest = [
        min(one.scale for one, band in zip(plan.bracket, plan.bands, strict=True) if one and band == name)
        for name in ("650nm", "760nm")
    ]
    assert shortest[1] > 8 * shortest[0]


def test_a_wheel_that_nobody_turns_is_refused(tmp_path: Path) -> None:
    wheels(tmp_path / "RIG.toml")
    bus_rig = BusRig(simulate("toy-wheel", samples=1))
    with pytest.raises(InputError, match="no operator turns the filter wheel to 650nm"):
        capture_rig(
            read_rig_file(tmp_path / "RIG.toml"),
            tmp_path / "S",
            backend=bus_rig.backend,
            clock=bus_rig.clock,
        )


@pytest.mark.parametrize(
    ("first", "second", "message"),
    [
        (WHEEL, "", "the cameras have other filters"),
        (WHEEL, WHEEL + '\nband = "650nm, 650, 40"', "this camera has a band and filters"),
        ("filters = []", "", "filters has to be 1 to 16 filters"),
        ('filters = ["red, red"]', "", "made of filters, each a name, its wavelength"),
        ('filters = ["red, 650", "RED, 640"]', "", "made of filters with names of their own"),
    ],
)
def test_wheels_that_are_none_are_refused_with_their_line(
    tmp_path: Path, first: str, second: str, message: str
) -> None:
    wheels(tmp_path / "RIG.toml", first, second)
    with pytest.raises(InputError, match=message) as refused:
        read_rig_file(tmp_path / "RIG.toml")
    assert "RIG.toml, line " in str(refused.value)


@pytest.mark.parametrize(
    ("filters", "message"),
    [
        ((FILTERS[0], None), "this camera has no band and others have"),
        ((FILTERS[0], "650nm, 640"), "another filter has the name '650nm' already"),
        (("650nm, red", FILTERS[1]), "a name, its wavelength and bandwidth in nm"),
        (("650nm, -1", FILTERS[1]), "a name, its wavelength and bandwidth in nm"),
    ],
)
def test_filters_that_are_no_bands_are_refused_with_their_line(
    tmp_path: Path, filters: tuple[str | None, ...], message: str
) -> None:
    write(tmp_path / "RIG.toml", *filters)
    with pytest.raises(InputError, match=message) as refused:
        read_rig_file(tmp_path / "RIG.toml")
    assert "RIG.toml, line " in str(refused.value)


def test_a_session_is_not_resumed_behind_another_filter(tmp_path: Path) -> None:
    write(tmp_path / "RIG.toml", *FILTERS)
    backend, clock = bus()
    capture_rig(read_rig_file(tmp_path / "RIG.toml"), tmp_path / "S", backend=backend, clock=clock)
    write(tmp_path / "RIG.toml", FILTERS[1], FILTERS[0])
    backend, clock = bus()
    with pytest.raises(InputError, match="behind 650nm"):
        capture_rig(
            read_rig_file(tmp_path / "RIG.toml"), tmp_path / "S", resume=True, backend=backend, clock=clock
        )

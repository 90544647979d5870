"""RIG.toml with a filter before each mono camera: the session knows the bands, and merges them."""

from functools import partial
from pathlib import Path

import pytest

from calib.exports.merge_session import merge_session
from capture.check.check import check, repair
from capture.connected_rig import capture_rig
from capture.rigfile.rigfile import read_rig_file
from capture.rigfile.template import rig_file_text
from drivers.discovery import ask_all
from drivers.sim.camera.camera import SimulatedCamera
from drivers.sim.filter_wheel import behind
from drivers.sim.ptp.profiles import profile
from drivers.sim.ptp.responder import Responder
from drivers.sim.ptp.usb_device import PtpDevice
from drivers.sim.rigs import simulate
from drivers.sim.usb.bus import VirtualBus
from drivers.sim.usb.virtual_clock import VirtualClock
from imaging.cfa import Cfa
from imaging.errors import InputError
from imaging.files.raw import read_raw
from imaging.session.records import Band
from imaging.session.session import Session

FILTERS = ("650nm, 650, 40", "550nm, 550, 30")
EXAMPLE = '# band = "650nm, 650, 40"'


def bus() -> tuple[VirtualBus, VirtualClock]:
    """Two mono cameras of the toy rig, each behind its filter."""
    rig, clock = simulate("toy", samples=1), VirtualClock()
    found = VirtualBus(clock)
    for index, wave in enumerate((650.0, 550.0)):
        body = behind(rig.bodies[index], Band(name=f"{wave:.0f}nm", wavelength_nm=wave))
        camera = SimulatedCamera(body, partial(rig.radiance, index))
        found.plug(PtpDevice(Responder(camera, profile("generic"), clock)))
    return found, clock


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
    merge_session(session.folder, tmp_path / "merged", None)
    assert len(list((tmp_path / "merged").rglob("*.exr"))) == 2
    index = session.folder / "shots.jsonl"
    index.write_text("".join(index.read_text().splitlines(keepends=True)[:-1]))
    before = {shot.file: shot.band for shot in Session.open(session.folder).shots()}
    repair(session.folder)
    after = {shot.file: shot.band for shot in Session.open(session.folder).shots()}
    assert len(after) == len(before) + 1
    assert before.items() <= after.items()
    assert None not in after.values()


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

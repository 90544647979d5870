"""Cameras of other packages: found by their entry points, examined, and left out where a package fails."""

import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import numpy as np
import pytest

from drivers.camera import CameraFile
from drivers.clock import SystemClock
from drivers.conformance import EXAMINATIONS, examine
from drivers.discovery import ask_all, find_cameras
from drivers.gige import Network
from drivers.sim.bus_rig import BusRig
from drivers.sim.rigs import simulate
from drivers.sim.usb.bus import VirtualBus
from imaging.files.tiff.dng import write_dng
from imaging.optics.exposure import Exposure
from imaging.sensor.cfa import Cfa
from imaging.sensor.mosaic import FrameMetadata, RawMosaic

PLUGIN = Path(__file__).resolve().parents[2] / "examples" / "plugin"


class NoNetwork(Network):
    """One without cameras."""

    def __init__(self) -> None: ...


@pytest.fixture
def nothing_else(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("drivers.gige.find_cameras", lambda network, clock: [])


def installed(folder: Path, point: str, code: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A package with one module and one entry point, as pip leaves them."""
    name = point.partition("=")[0]
    (folder / f"{name}.py").write_text(code)
    info = folder / f"{name}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: hdr-rig-{name}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[hdr_rig.cameras]\n{point}\n")
    if str(folder) not in sys.path:
        monkeypatch.syspath_prepend(str(folder))
    monkeypatch.delitem(sys.modules, name, raising=False)


CODE = """
class Toy:
    where = "nowhere"
    def verified(self): return "nothing"
    def identify(self):
        from drivers.camera import CameraIdentity
        return CameraIdentity("toy-1", "Toy", "One", "raw")
    def capabilities(self):
        from drivers.camera import Capabilities
        return Capabilities(4, 4, 8, (0.1,), (), ())
    def close(self): pass
def find(clock): return [Toy()]
"""


@pytest.mark.usefixtures("nothing_else")
def test_plug_ins_are_listed_and_those_that_fail_say_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    installed(tmp_path, "toys=toys:find", CODE, monkeypatch)
    installed(tmp_path, "broken=broken:find", "import nothing_of_that_name", monkeypatch)
    bus = BusRig(simulate("toy", seed=2, cameras=1))
    listed = {one.protocol: one for one in ask_all(bus.backend, bus.clock, network=NoNetwork())}
    assert set(listed) == {"PTP", "toys", "broken"}
    assert listed["toys"].identity is not None
    assert listed["toys"].identity.serial == "toy-1"
    assert "hdr-rig-broken finds no cameras (ModuleNotFoundError: " in listed["broken"].error
    assert "uninstall it" in listed["broken"].trouble
    assert len(find_cameras(bus.backend, bus.clock, NoNetwork())) == 2
    assert {one.protocol for one in ask_all(bus.backend, bus.clock)} == {"PTP"}  # a simulated bus alone


@pytest.fixture
def raspberry(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[CameraFile]:
    """A program that stands for rpicam-still, before a wall that is lit from one side; and the plug-in."""
    spec = spec_from_file_location("rpicam", PLUGIN / "rpicam.py")
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    frames, rng = tmp_path / "frames", np.random.Generator(np.random.PCG64(1))
    frames.mkdir()
    electrons = np.linspace(1e4, 4e5, 48 * 64).reshape(48, 64)
    for time in module.TIMES:
        for turn in (0, 1):
            light = rng.poisson(electrons * time) / 4 + rng.normal(64, 2, electrons.shape)
            mosaic = RawMosaic(
                np.clip(np.rint(light), 0, 1023).astype(np.uint16),
                Cfa.of("RGGB"), ((64.0, 64.0), (64.0, 64.0)), 1023,
                metadata=FrameMetadata(exposure=Exposure(time=time, iso=100.0)),
            )  # fmt: skip
            write_dng(frames / f"{round(1e6 * time)}-{turn}.dng", mosaic)
    program = tmp_path / "rpicam-still"
    program.write_text(
        f"""#!/bin/sh
while [ $# -gt 1 ]; do
  case $1 in --shutter) shutter=$2;; --output) out=$2;; esac
  shift
done
turn=$(cat {tmp_path}/turn 2>/dev/null || echo 0)
echo $((1 - turn)) > {tmp_path}/turn
cp {frames}/$shutter-$turn.dng "${{out%.jpg}}.dng"
"""
    )
    program.chmod(0o755)
    monkeypatch.setattr(module, "PROGRAM", str(program))
    return module


@pytest.mark.skipif(sys.platform == "win32", reason="a script of sh")
def test_the_example_does_what_rig_needs(raspberry) -> None:
    (camera,) = raspberry.find_cameras(SystemClock())
    by_name = {one.name: one.verdict for one in examine(camera, SystemClock())}
    assert by_name == {one.__name__: "passed" for one in EXAMINATIONS}


@pytest.mark.skipif(sys.platform == "win32", reason="a script of sh")
def test_the_example_says_what_the_program_says(raspberry, tmp_path: Path) -> None:
    (tmp_path / "rpicam-still").write_text("#!/bin/sh\necho no cameras available >&2\nexit 255\n")
    (camera,) = raspberry.find_cameras(SystemClock())
    row = next(one for one in examine(camera, SystemClock()) if one.name == "frames")
    assert row.verdict == "failed"
    assert "no cameras available" in row.says


def test_the_example_is_short_and_there_is_none_without_the_program(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, raspberry
) -> None:
    assert len((PLUGIN / "rpicam.py").read_text().splitlines()) <= 80
    monkeypatch.setattr(raspberry, "PROGRAM", str(tmp_path / "nothing"))
    assert raspberry.find_cameras(SystemClock()) == []
    assert find_cameras(VirtualBus(SystemClock()), SystemClock()) == []

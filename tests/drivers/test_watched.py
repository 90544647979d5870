"""The example plug-in that watches a folder, beside what drops files there as tethering software does."""

import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.conformance import EXAMINATIONS, examine
from drivers.errors import CameraRefused, CameraTimeout
from drivers.sim.usb.virtual_clock import VirtualClock
from imaging.files.tiff.dng import encode_dng
from imaging.optics.exposure import Exposure
from imaging.sensor.cfa import Cfa
from imaging.sensor.mosaic import FrameMetadata, RawMosaic

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "watched" / "watched.py"
OLD = 0.125
"""Seconds of exposure of the picture that lies there already."""
PASSED = {one.__name__: "passed" for one in EXAMINATIONS}


class Software:
    """Drops the frame of each exposure as tethering software does: half of it first, beside its JPEG.

    A wall that is lit from one side, with shot noise and read noise.
    """

    def __init__(self, folder: Path, clock: VirtualClock) -> None:
        self.folder, self.clock, self.shots = folder, clock, 0
        self._rng = np.random.Generator(np.random.PCG64(1))

    def frame(self, time: float) -> bytes:
        electrons = np.linspace(1e4, 4e5, 48 * 64).reshape(48, 64) * time
        light = self._rng.poisson(electrons) / 4 + self._rng.normal(64, 2, electrons.shape)
        mosaic = RawMosaic(
            np.clip(np.rint(light), 0, 1023).astype(np.uint16),
            Cfa.of("RGGB"), ((64.0, 64.0), (64.0, 64.0)), 1023,
            metadata=FrameMetadata(exposure=Exposure(time=time, iso=100.0)),
        )  # fmt: skip
        return encode_dng(mosaic)

    def shoot(self, time: float, files: int = 1) -> None:
        """Expose, and drop that many RAW files while time goes on."""
        for _ in range(files):
            self.shots += 1
            data, path = self.frame(time), self.folder / f"DSC{self.shots:05d}.DNG"
            half = len(data) // 2
            for delay, part in ((0.1, data[:half]), (2.0, data)):
                self.clock.call_later(time + delay, lambda path=path, part=part: path.write_bytes(part))
            for beside in (path.with_suffix(".JPG"), path.with_suffix(".xmp")):
                self.clock.call_later(time + 0.2, lambda beside=beside: beside.write_bytes(b"a preview"))


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock()


@pytest.fixture
def software(tmp_path: Path, clock: VirtualClock) -> Software:
    """With a picture that lies there already."""
    folder = tmp_path / "left"
    folder.mkdir()
    software = Software(folder, clock)
    (folder / "DSC00000.DNG").write_bytes(software.frame(OLD))
    return software


@pytest.fixture
def plugin(software: Software, monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setenv("RIG_WATCHED", str(software.folder))
    monkeypatch.delenv("RIG_SHOOT", raising=False)
    spec = spec_from_file_location("watched", EXAMPLE)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def asked(plugin: Any, software: Software, monkeypatch: pytest.MonkeyPatch) -> None:
    """RIG_SHOOT is a program that leaves a note for the software."""
    note = software.folder / "shoot"
    monkeypatch.setattr(plugin, "SHOOT", "echo {time} > {folder}/shoot")
    run = plugin.subprocess.run

    def noted(command: str, **options: Any) -> Any:
        done = run(command, **options)
        software.shoot(float(note.read_text()))
        return done

    monkeypatch.setattr(plugin.subprocess, "run", noted)


class Hand:
    """A person who presses the button when rig waits for it, the camera left at its one exposure."""

    def __init__(self, camera: Any, software: Software) -> None:
        self._camera, self._software = camera, software

    def __getattr__(self, name: str) -> Any:
        return getattr(self._camera, name)

    def trigger(self) -> float:
        opened = self._camera.trigger()
        self._software.shoot(OLD)
        return float(opened)


def verdicts(camera: Any, clock: VirtualClock) -> dict[str, str]:
    rows = list(examine(camera, clock))
    assert not [row for row in rows if row.verdict == "failed"], rows
    return {row.name: row.verdict for row in rows}


@pytest.mark.skipif(sys.platform == "win32", reason="a command of sh")
@pytest.mark.usefixtures("asked")
def test_software_that_takes_orders_passes_all_examinations(plugin: Any, clock: VirtualClock) -> None:
    (camera,) = plugin.find_cameras(clock)
    assert verdicts(camera, clock) == PASSED


def test_software_that_only_drops_files_passes_all_but_light(
    plugin: Any, software: Software, clock: VirtualClock
) -> None:
    """Light takes several exposures; there is one, that of the picture that lies there already."""
    (camera,) = plugin.find_cameras(clock)
    assert camera.capabilities().times == (OLD,)
    judged = verdicts(Hand(camera, software), clock)
    assert judged == PASSED | {"light": "skipped"}


def test_half_a_file_is_waited_for_and_what_lies_there_is_not_taken(
    plugin: Any, software: Software, clock: VirtualClock
) -> None:
    (camera,) = plugin.find_cameras(clock)
    camera.set_exposure(Exposure(time=OLD))
    camera.arm()
    camera.trigger()
    software.shoot(0.5)
    frame = camera.collect()
    assert frame.data == (software.folder / "DSC00001.DNG").read_bytes()
    assert frame.metadata.exposure.time == 0.5
    assert clock.now() > 2.0


def test_several_frames_of_one_shot_are_told(plugin: Any, software: Software, clock: VirtualClock) -> None:
    (camera,) = plugin.find_cameras(clock)
    camera.set_exposure(Exposure(time=OLD))
    camera.arm()
    camera.trigger()
    software.shoot(OLD, files=3)
    with pytest.raises(CameraRefused, match="got 3 RAW files for a shot: switch bursts off"):
        camera.collect()


def test_no_file_or_only_half_of_one_is_told(plugin: Any, software: Software, clock: VirtualClock) -> None:
    (camera,) = plugin.find_cameras(clock)
    for damaged in (b"", software.frame(OLD)[:-100]):
        camera.set_exposure(Exposure(time=OLD))
        camera.arm()
        camera.trigger()
        if damaged:
            (software.folder / "DSC1.DNG").write_bytes(damaged)
        with pytest.raises(CameraTimeout, match="got no whole RAW file"):
            camera.collect()


def test_a_program_that_fails_is_told(
    plugin: Any, clock: VirtualClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(plugin, "SHOOT", "exit 3")
    (camera,) = plugin.find_cameras(clock)
    camera.set_exposure(Exposure(time=0.01))
    camera.arm()
    with pytest.raises(CameraRefused, match="run RIG_SHOOT by hand"):
        camera.trigger()


def test_an_empty_folder_is_no_camera_to_shoot_with_and_the_example_is_short(
    plugin: Any, clock: VirtualClock, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(plugin, "WATCHED", str(tmp_path / "nothing"))
    (camera,) = plugin.find_cameras(clock)
    assert camera.capabilities().obstacle == "its folder has no RAW file yet"
    monkeypatch.setattr(plugin, "WATCHED", "")
    assert plugin.find_cameras(clock) == []
    assert len(EXAMPLE.read_text().splitlines()) < 80

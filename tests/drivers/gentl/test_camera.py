"""GenTL cameras: a simulated one behind a producer of rig's own, and Viky, of the package genicam."""

import ctypes
import shutil
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from drivers.clock import SystemClock
from drivers.conformance import EXAMINATIONS, examine
from drivers.discovery import ask_all
from drivers.discovery import find_cameras as all_cameras
from drivers.errors import CameraClaimed, CameraLost, CameraProtocol, CameraRefused, CameraTimeout
from drivers.genicam.settings import lock, prepare, stop
from drivers.gentl import ENVIRONMENT, GentlCamera, find_cameras, installed
from drivers.gentl.abi import BufferInfo, Code, DeviceInfo, Library, StreamInfo
from drivers.gentl.producer import Producer, producer
from drivers.gentl.session import GentlSession, Port, read_xml
from drivers.sim.usb.bus import VirtualBus
from drivers.sim.usb.virtual_clock import VirtualClock
from imaging.optics.exposure import Exposure
from imaging.sensor.mosaic import RawMosaic
from tests.drivers.shots import raw_shot
from tests.drivers.test_plugins import NoNetwork

from .conftest import SimulatedDevice, only


def shoot(camera: GentlCamera, time: float) -> RawMosaic:
    return raw_shot(camera, Exposure(time=time))


def test_it_passes_all_examinations(simulated: SimulatedDevice) -> None:
    rows = list(examine(only(SystemClock()), SystemClock()))
    assert [row.verdict for row in rows] == ["passed"] * len(EXAMINATIONS), rows


def test_frames_are_those_of_the_sensor_when_its_shutter_opened(simulated: SimulatedDevice) -> None:
    camera = only(SystemClock())
    frame = shoot(camera, 1 / 500)
    sensor = simulated.camera
    assert frame.metadata.exposure is not None
    assert (frame.cfa, frame.white, frame.metadata.serial) == (sensor.body.cfa, 4095, simulated.serial)
    assert frame.metadata.exposure.time == pytest.approx(1 / 500, rel=0.05)  # that of its chunk
    assert np.unique(frame.pixels).size > 100
    assert frame.metadata.opened == pytest.approx(simulated.opened[-1], abs=0.005)
    exposures = [Exposure(time=time, iso=100.0) for time in (1 / 2000, 1 / 1000, 1 / 500)]
    means = [float(np.mean(one.pixels) - np.mean(one.black)) for one in camera.bracket(exposures)]
    assert np.diff(np.log2(means)) == pytest.approx([1.0, 1.0], abs=0.1)
    camera.close()
    camera.close()
    assert producer(installed()[0]).library._functions.fixture_opened() == 0


def test_a_frame_with_parts_missing_is_told(simulated: SimulatedDevice) -> None:
    camera = only(SystemClock())
    simulated.cut = True
    with pytest.raises(CameraProtocol, match="its producer reports missing parts"):
        shoot(camera, 1 / 500)
    simulated.cut = False
    assert shoot(camera, 1 / 500).pixels.shape == (48, 64)
    camera.close()


def test_rows_with_padding_are_those_of_the_sensor(simulated: SimulatedDevice) -> None:
    camera = only(SystemClock())
    for simulated.padding in (0, 5):
        assert np.array_equal(shoot(camera, 1 / 500).pixels, simulated.taken[-1].pixels)
    camera.close()


def test_what_is_no_image_is_refused(simulated: SimulatedDevice) -> None:
    camera = only(SystemClock())
    for simulated.kind in (5, 10, 11):  # JPEG, multi-part, GenDC
        with pytest.raises(CameraRefused, match=rf"payloads of type {simulated.kind:#06x}, not images"):
            shoot(camera, 1 / 500)
    for simulated.kind in (0, 1, 4):
        assert shoot(camera, 1 / 500).pixels.shape == (48, 64)
    camera.close()


def test_containers_of_viky_are_refused_and_switched_off(viky: Path) -> None:
    session = GentlSession(producer(installed()[0]).cameras()[0])
    session.nodes.set("PixelFormat", "Mono8")
    session.nodes.set("GenDCStreamingMode", "On")
    session.stream.start()
    session.nodes.execute("AcquisitionStart")
    with pytest.raises(CameraRefused, match="payloads of type 0x000b, not images"):
        session.stream.next_frame(5.0)
    session.nodes.execute("AcquisitionStop")
    session.stream.stop()
    prepare(session.nodes, "camera 0")
    assert session.nodes.text("GenDCStreamingMode") == "Off"
    session.close()


def test_a_camera_that_is_unplugged_is_told_and_found_again(simulated: SimulatedDevice) -> None:
    camera = only(SystemClock())
    unplug = producer(installed()[0]).library._functions.fixture_unplug
    camera.set_exposure(Exposure(time=1 / 500))
    camera.arm()
    unplug(1)
    said = r"GenTL fixture camera: .*GCWritePort fails with -1010 \(there is no answer\): check its cable"
    with pytest.raises(CameraLost, match=said):
        camera.trigger()
    assert list(find_cameras(SystemClock())) == []
    unplug(0)
    assert shoot(camera, 1 / 500).pixels.shape == (48, 64)
    camera.close()


def test_a_camera_that_another_program_has_is_told(simulated: SimulatedDevice) -> None:
    holder, camera = only(SystemClock()), only(SystemClock())
    holder.identify()
    with pytest.raises(CameraClaimed, match=r"fails with -1004 \(it is opened already\): close the other"):
        camera.identify()
    holder.close()
    assert camera.identify().serial == simulated.serial
    camera.close()


def test_viky_streams_and_its_features_are_locked_meanwhile(viky: Path) -> None:
    """A producer that others wrote; its three cameras play ball games."""
    red, *others = producer(installed()[0]).cameras()
    assert [one.serial for one in (red, *others)] == ["0", "1", "2"]
    session = GentlSession(red)
    assert (session.make, session.model) == ("Machine Vision Games Ltd.", "Viky")
    session.nodes.set("PixelFormat", "Mono8")
    session.stream.start()
    lock(session.nodes, True)
    session.nodes.execute("AcquisitionStart")
    assert not session.nodes.writable("GenDCStreamingMode")
    shown = [session.stream.next_frame(5.0) for _ in range(6)]
    session.nodes.execute("AcquisitionStop")
    session.stream.stop()
    stop(session.nodes)
    assert session.nodes.writable("GenDCStreamingMode")
    assert [one.problem for one in shown] == [None] * 6
    assert {(one.leader.width, one.leader.height, one.leader.pixel_format) for one in shown} == {
        (400, 400, 0x01080001)
    }
    assert list(np.diff([one.leader.block for one in shown])) == [1] * 5
    pictures = [one.payload[: 400 * 400].reshape(400, 400) for one in shown]
    assert any(np.any(pictures[0] != picture) for picture in pictures)  # the ball moves
    with pytest.raises(CameraTimeout, match=r"sent no frame within 0\.05 s: check trigger and exposure"):
        session.stream.next_frame(0.05)
    session.close()
    session.close()


def test_a_camera_without_a_trigger_is_refused(viky: Path) -> None:
    camera = next(iter(find_cameras(SystemClock())))
    assert isinstance(camera, GentlCamera)
    with pytest.raises(CameraRefused, match=r"^camera 0 cannot be triggered \(GenTL viky VikyTL_DEV_red\)"):
        camera.identify()


def test_numbers_are_those_of_the_standard(viky: Path) -> None:
    """Compare with the committee's own package."""
    gentl: Any = pytest.importorskip("genicam.gentl")
    for ours, theirs, prefix in (
        (DeviceInfo, gentl.DEVICE_INFO_CMD_LIST, "DEVICE_INFO_"),
        (StreamInfo, gentl.STREAM_INFO_CMD_LIST, "STREAM_INFO_"),
        (BufferInfo, gentl.BUFFER_INFO_CMD_LIST, "BUFFER_INFO_"),
        (Code, gentl.GC_ERROR_LIST, "GC_ERR_"),
    ):
        for one in ours:
            assert getattr(theirs, prefix + one.name) == one.value


@pytest.mark.usefixtures("no_gige")
def test_they_are_listed_once_beside_the_others(
    simulated: SimulatedDevice, monkeypatch: pytest.MonkeyPatch
) -> None:
    bus = VirtualBus(VirtualClock())
    (one,) = ask_all(bus, SystemClock(), network=NoNetwork())
    assert (one.protocol, one.where, one.error) == ("GenTL", "GenTL fixture", "")
    assert one.capabilities is not None
    assert (one.capabilities.width, one.capabilities.height) == (64, 48)
    assert list(ask_all(bus, SystemClock())) == []  # a simulated bus has nothing beside it
    ours = only(SystemClock())  # as rig's own driver would find it
    monkeypatch.setattr("drivers.gige.find_cameras", lambda network, clock: [ours])
    (one,) = ask_all(bus, SystemClock(), network=NoNetwork())
    assert one.protocol == "GigE Vision"


@pytest.mark.usefixtures("no_gige")
def test_the_first_producer_has_a_camera_that_two_list(monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = (
        cast(Producer, SimpleNamespace(library=SimpleNamespace(where=name))) for name in ("first", "second")
    )
    listed = [("a", first), ("b", first), ("b", first), ("a", second), ("c", second)]
    cameras = [GentlCamera(serial, one, SystemClock()) for serial, one in listed]
    monkeypatch.setattr("drivers.gentl.find_cameras", lambda clock: cameras)
    assert all_cameras(VirtualBus(VirtualClock()), SystemClock(), NoNetwork()) == [*cameras[:3], cameras[4]]


def test_a_producer_that_cannot_start_is_tried_again(
    fixture_path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = Path(shutil.copy(fixture_path, tmp_path / "later.cti"))
    at_exit: list[Callable[[], None]] = []
    monkeypatch.setattr("drivers.gentl.producer.atexit.register", at_exit.append)
    unplug = ctypes.CDLL(str(path)).fixture_unplug
    unplug(1)
    with pytest.raises(CameraLost, match="TLOpen fails"):
        Producer(path)
    assert at_exit == []
    unplug(0)
    assert Producer(path).cameras() == []
    (close,) = at_exit
    close()


class _Described:
    """A producer and a device, with that URL of a description and those bytes at 0x8000."""

    def __init__(self, url: str, data: bytes) -> None:
        self._url, self._data = url, data

    def call(self, name: str, port: int, count: Any, *, where: str) -> None:
        count._obj.value = 1

    def info_text(self, *arguments: object) -> str:
        return self._url

    def read(self, address: int, size: int) -> bytes:
        return self._data[address - 0x8000 :][:size]

    def description(self) -> bytes:
        return read_xml(cast(Library, self), 1, cast(Port, self), "GenTL fixture camera")


@pytest.mark.parametrize("place", ["8000;6", "0x8000;0x6", " 8000; 6?SchemaVersion=1.1.0"])
def test_the_place_of_a_description_may_have_prefixes_and_blanks(place: str) -> None:
    assert _Described(f"Local:cam.xml;{place}", b"<xml/>more").description() == b"<xml/>"


def test_a_damaged_description_names_the_camera() -> None:
    with pytest.raises(
        CameraProtocol, match=r"^GenTL fixture camera: .* cannot be unzipped .*: update its firmware\.$"
    ):
        _Described("Local:cam.zip;8000;10", b"PK\3\4" + bytes(12)).description()


@pytest.mark.usefixtures("no_gige")
def test_a_file_that_is_no_producer_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "broken.cti").write_text("no library")
    monkeypatch.setenv(ENVIRONMENT, str(tmp_path))
    (one,) = ask_all(VirtualBus(VirtualClock()), SystemClock(), network=NoNetwork())
    assert "broken.cti is no GenTL producer that can be used (file too short): install" in one.error
    monkeypatch.delenv(ENVIRONMENT)
    assert installed() == []


@pytest.fixture
def no_gige(monkeypatch: pytest.MonkeyPatch) -> None:
    """There is neither a network nor anything that libgphoto2 may find."""
    monkeypatch.setattr("drivers.gige.find_cameras", lambda network, clock: [])
    monkeypatch.setattr("drivers.choice.is_installed", lambda: False)

"""GenTL producers: Viky, which the package genicam brings, and one of rig's own before a simulated camera."""

import ctypes
import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from drivers.clock import Clock
from drivers.genicam.chunks import join_chunks, split_chunks
from drivers.gentl import ENVIRONMENT, GentlCamera, find_cameras
from drivers.sim.camera.camera import SimulatedCamera
from drivers.sim.genicam import frames
from drivers.sim.genicam.acquisition import Acquisition
from drivers.sim.genicam.feature_registers import CHUNK_IMAGE, Feature
from drivers.sim.genicam.lines import Oscillator
from drivers.sim.genicam.memory import XML, Denied
from drivers.sim.genicam.power_on import checks_of, description_of, power_on
from drivers.sim.rigs import simulate
from drivers.sim.u3v.device import _USB
from drivers.sim.u3v.memory import DeviceMemory
from drivers.sim.usb.timeline import LiveTimeline
from drivers.u3v.registers import Abrm, ManifestEntry
from imaging.sensor.cfa import Cfa
from imaging.sensor.mosaic import RawMosaic

ACCESS = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_uint64, ctypes.c_void_p, ctypes.c_size_t)
_MANIFEST = 0x3000


class Meta(ctypes.Structure):
    """Metadata of a frame for producer.c."""

    _fields_ = tuple(
        (name, ctypes.c_uint64)
        for name in ("block", "timestamp", "format", "width", "height", "chunks", "cut", "kind", "padding")
    )


class SimulatedDevice:
    """A simulated machine vision camera whose registers and frames go through producer.c; a bright wall."""

    def __init__(self, library: ctypes.CDLL, timeline: LiveTimeline) -> None:
        body = next(body for body in simulate("toy").bodies if body.cfa != Cfa.MONO)
        lens = body.optics.lens
        shape = lens.height, lens.width, 3
        view = np.linspace(6.0, 1200.0, lens.height * lens.width * 3, dtype=np.float32).reshape(shape)
        self.camera = camera = SimulatedCamera(body, lambda frame: view)
        self.cut, self.kind, self.opened = False, 1, list[float]()
        self.padding, self.taken = 0, list[RawMosaic]()
        self._library, self._timeline = library, timeline
        identity = camera.identify()
        self.serial = identity.serial
        names = {Abrm.MANUFACTURER: identity.make, Abrm.MODEL: identity.model, Abrm.SERIAL: identity.serial}
        self.memory = DeviceMemory(names, description_of(camera, _USB))
        power_on(camera, self.memory)
        self._checks, self._block = checks_of(camera), 0
        self._oscillator = Oscillator.of(body.seed, identity.serial)
        self._acquisition = Acquisition(
            camera, self.memory, timeline, lambda: True, self._deliver,
            lambda is_open, when: self.opened.append(when) if is_open else None,
        )  # fmt: skip
        self._refresh()
        self._functions = ACCESS(self._read), ACCESS(self._write)
        entry = ManifestEntry.parse(self.memory.read(_MANIFEST + 8, 64))
        url = f"Local:///description.zip;{XML:X};{entry.size:X}?SchemaVersion=1.1.0"
        library.fixture_connect(*self._functions, url.encode(), self.serial.encode())

    def _read(self, address: int, place: int, size: int) -> int:
        try:
            with self._timeline.lock:
                ctypes.memmove(place, self.memory.read(address, size), size)
        except Denied:
            return 1
        return 0

    def _write(self, address: int, place: int, size: int) -> int:
        data = ctypes.string_at(place, size)
        try:
            with self._timeline.lock:
                self._checks.check(self.memory, address, data)
                self.memory.write(address, data)
                self._refresh()
                if address == Abrm.LATCH:
                    self.memory.latch(self._oscillator.nanoseconds(self._timeline.now()))
                self._acquisition.written(address)
        except Denied:
            return 1
        return 0

    def _refresh(self) -> None:
        body = self.camera.body
        size = frames.refresh(self.memory, body.cfa, body.sensor.black, body.sensor.bit_depth)
        self.memory.require(size)
        padded = size + self.memory.get(Feature.HEIGHT) * self.padding
        self._library.fixture_size(ctypes.c_size_t(padded if self.padding else 0))

    def _deliver(self, mosaic: RawMosaic, time: float, opened: float) -> None:
        image = frames.frame(self.memory, mosaic, self.camera.body.sensor.bit_depth, time)
        self.taken.append(mosaic)
        self._block += 1
        stamp = self._oscillator.nanoseconds(opened)
        size = (image.width, image.height)
        state = int(image.chunked), int(self.cut), self.kind, self.padding
        meta = Meta(self._block, stamp, image.code, *size, *state)
        payload = self._padded(image)
        self._library.fixture_deliver(payload, ctypes.c_size_t(len(payload)), ctypes.byref(meta))

    def _padded(self, image: frames.SentImage) -> bytes:
        """The payload with `padding` bytes after each row."""
        order, data = self.memory.order, np.frombuffer(image.payload, np.uint8)
        pixels, chunks = split_chunks(data, order) if image.chunked else (data, {})
        rows = np.pad(pixels.reshape(image.height, -1), ((0, 0), (0, self.padding))).tobytes()
        return join_chunks([(CHUNK_IMAGE, rows), *chunks.items()], order) if image.chunked else rows


@pytest.fixture(scope="session")
def fixture_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Rig's own producer, built: a process initialises it once."""
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("there is no C compiler")
    path = tmp_path_factory.mktemp("gentl") / "fixture.cti"
    source = Path(__file__).with_name("producer.c")
    subprocess.run([compiler, "-shared", "-fPIC", "-pthread", "-o", str(path), str(source)], check=True)
    return path


@pytest.fixture
def simulated(fixture_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[SimulatedDevice]:
    """The simulated camera, which only that producer finds."""
    timeline = LiveTimeline()
    monkeypatch.setenv(ENVIRONMENT, str(fixture_path.parent))
    yield SimulatedDevice(ctypes.CDLL(str(fixture_path)), timeline)
    timeline.close()


@pytest.fixture
def viky(monkeypatch: pytest.MonkeyPatch) -> Path:
    """The producer that the package genicam brings; its folder is where producers are looked for."""
    genicam = pytest.importorskip("genicam", reason="the package genicam is not installed")
    path = Path(genicam.__file__).parent / "viky.cti"
    if not path.is_file():
        pytest.skip("this package genicam has no producer")
    monkeypatch.setenv(ENVIRONMENT, os.pathsep.join([str(path.parent), "", str(path.parent)]))
    return path


def only(clock: Clock) -> GentlCamera:
    (camera,) = find_cameras(clock)
    assert isinstance(camera, GentlCamera), camera
    return camera

"""Bodies for libgphoto2: simulated ones that another process serves over PTP/IP, and its own virtual one."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from drivers.clock import SystemClock
from drivers.gphoto2.camera import Gphoto2Camera, cameras_at

SERVE = """
import sys
from contextlib import ExitStack
from dataclasses import replace
import numpy as np
from drivers.sim.camera.camera import SimulatedCamera
from drivers.sim.ptp.profiles import profile
from drivers.sim.ptp.ptpip import PtpIpServer, listen
from drivers.sim.ptp.responder import Responder
from drivers.sim.rigs import simulate
from drivers.sim.usb.timeline import LiveTimeline

body = simulate("toy").bodies[0]
lens = body.optics.lens
shape = lens.height, lens.width, 3
view = np.linspace(0.2, 40.0, lens.height * lens.width * 3, dtype=np.float32).reshape(shape)
served = {}
for line in sys.stdin:
    name, port, jpeg = line.split()
    if name == "stop":
        served.pop(int(port)).close()
    else:
        with ExitStack() as stack:
            timeline = LiveTimeline()
            stack.callback(timeline.close)
            camera = SimulatedCamera(body, lambda frame: view)
            responder = Responder(camera, replace(profile(name), jpeg=jpeg == "True"), timeline)
            server = stack.enter_context(PtpIpServer(responder, listen(port=int(port))))
            port = server.port
            served[port] = stack.pop_all()
    print(port, flush=True)
for one in served.values():
    one.close()
"""
"""Of another process: while it asks for a summary, the package gphoto2 lets no other thread run."""


class Bodies:
    """The process that serves simulated bodies, each before a bright wall, on ports of this machine."""

    def __init__(self) -> None:
        command = [sys.executable, "-c", SERVE]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def order(self, name: str, port: int, jpeg: bool = False) -> int:
        """The port of a body that begins, or of one that ends, by the name `stop`."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        print(name, port, jpeg, file=self._process.stdin, flush=True)
        return int(self._process.stdout.readline())

    def close(self) -> None:
        self._process.communicate()


class Served:
    """A simulated body, until it is stopped."""

    def __init__(self, bodies: Bodies, name: str, port: int = 0, *, jpeg: bool = False) -> None:
        self._bodies, self._stopped = bodies, False
        self.port = bodies.order(name, port, jpeg)

    def camera(self) -> Gphoto2Camera:
        (camera,) = cameras_at([("127.0.0.1", self.port)], SystemClock())
        return camera

    def stop(self) -> None:
        if not self._stopped:
            self._bodies.order("stop", self.port)
        self._stopped = True


@pytest.fixture(scope="session")
def bodies() -> Iterator[Bodies]:
    pytest.importorskip("gphoto2", reason="the package gphoto2 is not installed")
    bodies = Bodies()
    yield bodies
    bodies.close()


@pytest.fixture
def serve(bodies: Bodies, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Callable[..., Served]]:
    monkeypatch.setenv("HOME", str(tmp_path))  # libgphoto2 keeps its settings there
    served: list[Served] = []

    def start(name: str, port: int = 0, *, jpeg: bool = False) -> Served:
        served.append(Served(bodies, name, port, jpeg=jpeg))
        return served[-1]

    yield start
    for one in served:
        one.stop()


@pytest.fixture
def virtual(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """libgphoto2's virtual Nikon, which the wheel brings, is what it finds on the USB; the picture in it."""
    gphoto2 = pytest.importorskip("gphoto2", reason="the package gphoto2 is not installed")
    folder = Path(gphoto2.__file__).parent / "libgphoto2" / "vusb"
    if not (folder / "vusb.so").is_file():
        pytest.skip("this package gphoto2 has no virtual camera")
    picture = tmp_path / "card" / "DCIM" / "100RIGXX" / "IMG_0001.JPG"
    picture.parent.mkdir(parents=True)
    Image.fromarray((np.arange(48 * 64 * 3) % 251).astype(np.uint8).reshape(48, 64, 3)).save(picture)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("IOLIBS", str(folder))
    monkeypatch.setenv("VCAMERADIR", str(tmp_path / "card"))
    return picture

"""Bodies for libgphoto2: simulated ones that another process serves over PTP/IP, and its own virtual one."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from drivers.clock import SystemClock
from drivers.gphoto2 import Gphoto2Camera, cameras_at

SERVE = """
import sys
from dataclasses import replace
import numpy as np
from drivers.sim.camera.camera import SimulatedCamera
from drivers.sim.ptp.profiles import profile
from drivers.sim.ptp.ptpip import PtpIpServer, listen
from drivers.sim.ptp.responder import Responder
from drivers.sim.rigs import simulate
from drivers.sim.usb.timeline import LiveTimeline

name, port, jpeg = sys.argv[1], int(sys.argv[2]), sys.argv[3] == "True"
body, timeline = simulate("toy").bodies[0], LiveTimeline()
lens = body.optics.lens
shape = lens.height, lens.width, 3
view = np.linspace(0.2, 40.0, lens.height * lens.width * 3, dtype=np.float32).reshape(shape)
responder = Responder(SimulatedCamera(body, lambda frame: view), replace(profile(name), jpeg=jpeg), timeline)
with PtpIpServer(responder, listen(port=port)) as server:
    print(server.port, flush=True)
    sys.stdin.read()
timeline.close()
"""
"""A process each: while it asks for a summary, the package gphoto2 lets no other thread run."""


class Served:
    """A simulated body, before a bright wall, on a port of this machine."""

    def __init__(self, name: str, port: int = 0, *, jpeg: bool = False) -> None:
        command = [sys.executable, "-c", SERVE, name, str(port), str(jpeg)]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self._process.stdout is not None
        self.port = int(self._process.stdout.readline())

    def camera(self) -> Gphoto2Camera:
        (camera,) = cameras_at([("127.0.0.1", self.port)], SystemClock())
        return camera

    def stop(self) -> None:
        if self._process.poll() is None:
            self._process.communicate()


@pytest.fixture
def serve(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Callable[..., Served]]:
    pytest.importorskip("gphoto2", reason="the package gphoto2 is not installed")
    monkeypatch.setenv("HOME", str(tmp_path))  # libgphoto2 keeps its settings there
    served: list[Served] = []

    def start(name: str, port: int = 0, *, jpeg: bool = False) -> Served:
        served.append(Served(name, port, jpeg=jpeg))
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

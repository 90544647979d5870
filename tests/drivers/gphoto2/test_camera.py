"""The driver above libgphoto2, judged by the examinations of `rig doctor --camera`."""

import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace

import pytest

from drivers.clock import SystemClock
from drivers.conformance import EXAMINATIONS, Subject, examine, frames, identity, settings
from drivers.errors import CameraRefused
from drivers.gphoto2.body import Body
from drivers.gphoto2.camera import Gphoto2Camera, cameras_at, find_cameras
from drivers.gphoto2.library import library
from imaging.errors import CameraError
from imaging.optics.exposure import Exposure
from tests.drivers.shots import shot

from .conftest import Served

Serve = Callable[..., Served]
Asked = Callable[[Subject], str]
ALL = {one.__name__: "passed" for one in EXAMINATIONS}


def verdicts(camera: Gphoto2Camera, asked: Sequence[Asked] = EXAMINATIONS) -> dict[str, str]:
    rows = list(examine(camera, SystemClock(), examinations=asked))
    assert not [row for row in rows if row.verdict == "failed"], rows
    return {row.name: row.verdict for row in rows}


def test_a_body_passes_all_examinations(serve: Serve) -> None:
    assert verdicts(serve("generic").camera()) == ALL


def test_a_nikon_passes_them(serve: Serve) -> None:
    """All of them, as Sony and Canon bodies do, in 20, 20 and 150 s: libgphoto2 waits for their events."""
    assert set(verdicts(serve("nikon-z6").camera(), (identity, settings, frames)).values()) == {"passed"}


def test_libgphoto2s_own_virtual_camera_passes_them(virtual: Path) -> None:
    """It has a picture from the beginning, and hands that out."""
    (camera,) = find_cameras(SystemClock())
    assert (camera.where, camera.identify().kind) == ("gphoto2:usb:001,001", "ldr")
    assert verdicts(camera) == ALL | {"light": "skipped"}
    frame = shot(camera, Exposure(time=0.01, f_number=5.6))
    assert (frame.data, frame.suffix) == (virtual.read_bytes(), ".jpg")
    camera.close()


def test_a_canon_shoots(serve: Serve) -> None:
    camera = serve("canon-eos-6d").camera()
    asked = Exposure(time=1 / 500, f_number=5.6, iso=200.0)
    frame = shot(camera, asked)
    assert (frame.suffix, frame.metadata.exposure) == (".cr2", asked)
    camera.close()


def test_raw_and_jpeg_come_together(serve: Serve) -> None:
    camera = serve("sony-a7m4", jpeg=True).camera()
    frame = shot(camera, Exposure(time=1 / 500))
    assert frame.suffix in (".arw", ".dng")
    assert frame.developed is not None
    assert (frame.developed[0], frame.developed[1][:2]) == (".jpg", b"\xff\xd8")
    camera.close()


class _Chatty:
    """libgphoto2 and a body of it that tells something every 0.7 s, and at `stored` s its second file."""

    GP_EVENT_UNKNOWN, GP_EVENT_TIMEOUT, GP_EVENT_FILE_ADDED = range(3)

    def __init__(self, stored: float) -> None:
        self.now, self._stored = 0.0, stored

    def wait_for_event(self, milliseconds: int) -> tuple[int, object]:
        self.now += min(0.7, milliseconds / 1000)
        if self.now > self._stored:
            return self.GP_EVENT_FILE_ADDED, SimpleNamespace(folder="/", name="IMG.JPG")
        return self.GP_EVENT_UNKNOWN, "PTP Property d215 changed"


def test_the_second_file_of_a_body_that_tells_other_things_is_not_waited_for_without_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pytest.importorskip("gphoto2", reason="the package gphoto2 is not installed")
    for stored, file in ((5.0, ("/", "IMG.JPG")), (60.0, None)):
        body, chatty = Body.__new__(Body), _Chatty(stored)
        body._gp, body._where, body._camera, body._both = chatty, "gphoto2:usb:001,001", chatty, True
        monkeypatch.setattr("drivers.gphoto2.body.monotonic", lambda chatty=chatty: chatty.now)
        assert body.beside(("/", "IMG.CR2")) == file
        assert chatty.now < 11.0


def test_a_body_that_goes_is_told_and_found_again(serve: Serve) -> None:
    served = serve("generic")
    camera = served.camera()
    camera.set_exposure(Exposure(time=1 / 500))
    camera.arm()
    served.stop()
    with pytest.raises(
        CameraError, match=r"gphoto2:ptpip:127\.0\.0\.1:\d+ answers .* through libgphoto2: check"
    ):
        camera.trigger()
    with pytest.raises(CameraError, match="call set_exposure, arm, trigger and collect in this order"):
        camera.collect()
    serve("generic", served.port)
    frame = shot(camera, Exposure(time=1 / 500))
    assert frame.metadata.exposure is not None
    assert frame.metadata.exposure.time == 1 / 500
    camera.close()


def test_nothing_of_this_process_is_closed(serve: Serve) -> None:
    """libgphoto2 closes file 0 when it lets go of a camera on the network, and not that of rig."""
    before = os.fstat(0)
    camera = serve("generic").camera()
    camera.identify()
    camera.close()
    assert os.path.samestat(os.fstat(0), before)


def test_the_process_of_a_camera_imports_only_what_it_serves_with() -> None:
    program = "import sys; from drivers.gphoto2.process import serve; print(*sys.modules)"
    loaded = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    ).stdout.split()
    assert "drivers.gphoto2.body" in loaded
    assert not {"numpy", "pydantic", "drivers.camera", "drivers.ptp"} & set(loaded)


def test_without_the_package_the_command_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gphoto2", None)
    with pytest.raises(
        CameraRefused, match=r"^libgphoto2 is not installed: pip install -e '\.\[gphoto2\]'\.$"
    ):
        library()
    (camera,) = cameras_at([("127.0.0.1", 9)], SystemClock())
    with pytest.raises(CameraRefused, match="pip install"):
        camera.identify()

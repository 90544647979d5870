"""The PTP/IP front end, judged by the newest libgphoto2, which comes in the wheel `gphoto2`."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.sim.camera.camera import SimulatedCamera
from drivers.sim.ptp.profiles import PROFILES, profile
from drivers.sim.ptp.ptpip import PtpIpServer, listen
from drivers.sim.ptp.responder import Responder
from drivers.sim.rigs import simulate
from drivers.sim.usb.timeline import LiveTimeline
from imaging.files.tiff.dng import encode_dng
from tests.drivers.shots import raw_shot

FAST = dict.fromkeys(PROFILES, "1/250") | {"generic": "0.0040s", "nikon-z6": "0.0040s"}
"""1/250 s as libgphoto2 writes it for each profile."""


@pytest.fixture(scope="module")
def gp() -> Any:
    return pytest.importorskip("gphoto2", reason="the package gphoto2 is not installed")


def sensor() -> SimulatedCamera:
    body = simulate("toy").bodies[0]
    lens = body.optics.lens
    view = np.linspace(0.01, 2.0, lens.height * lens.width * 3, dtype=np.float32)
    return SimulatedCamera(body, lambda frame: view.reshape(lens.height, lens.width, 3))


SCRIPT = """
import sys
import gphoto2 as gp

where, folder, settings = sys.argv[1], sys.argv[2], sys.argv[3:]
camera, models, ports = gp.Camera(), gp.CameraAbilitiesList(), gp.PortInfoList()
models.load()
camera.set_abilities(models[models.lookup_model("PTP/IP Camera")])
ports.load()
camera.set_port_info(ports[ports.lookup_path(where)])
camera.init()
for shot, step in enumerate(settings):
    for one in step.split(","):
        name, _, value = one.partition("=")
        widget = camera.get_single_config(name)
        widget.set_value(value)
        camera.set_single_config(name, widget)
        assert camera.get_single_config(name).get_value() == value, one
    path = camera.capture(gp.GP_CAPTURE_IMAGE)
    camera.file_get(path.folder, path.name, gp.GP_FILE_TYPE_NORMAL).save(f"{folder}/{shot}")
try:
    camera.exit()
except gp.GPhoto2Error:
    pass  # on leaving it waits for an event, which a Canon does not send over PTP/IP
"""
"""Shoots once for each step, as `iso=400,capturetarget=...`; a process each, for libgphoto2 has one state."""


@pytest.mark.parametrize("name", PROFILES)
def test_libgphoto2_sets_shoots_and_downloads(
    gp: Any, timeline: LiveTimeline, tmp_path: Path, name: str
) -> None:
    responder = Responder(sensor(), profile(name), timeline)
    has_target = name.startswith(("canon", "nikon"))
    second = "iso=200,capturetarget=Memory card" if has_target else "iso=200"
    with PtpIpServer(responder, listen(port=0)) as server:
        where = f"ptpip:{server.host}:{server.port}:{server.port}"
        steps = f"iso=400,shutterspeed={FAST[name]}", second
        done = subprocess.run(
            [sys.executable, "-c", SCRIPT, where, str(tmp_path), *steps],
            env=os.environ | {"HOME": str(tmp_path), "LC_ALL": "C"},
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
    assert done.returncode == 0, done.stderr
    twin = sensor()
    for shot, iso in enumerate((400, 200)):
        frame = raw_shot(twin, responder.shooting.exposure.model_copy(update={"iso": iso}))
        assert (tmp_path / str(shot)).read_bytes() == encode_dng(frame)
    assert responder.shooting.shots == 2


@pytest.mark.parametrize("name", [name for name in PROFILES if name != "generic"])
def test_usb_ids_are_those_of_the_model(gp: Any, name: str) -> None:
    """libgphoto2 knows cameras by USB vendor and product, under names of its own."""
    models = gp.CameraAbilitiesList()
    models.load()
    simulated = profile(name)
    known = [
        models[index].model
        for index in range(models.count())
        if (models[index].usb_vendor, models[index].usb_product) == (simulated.vendor, simulated.product)
    ]
    called = {
        "canon-eos-6d": "EOS 6D",
        "canon-eos-r7": "EOS R7",
        "nikon-z6": "Z6",
        "sony-a7m4": "Alpha-A7 IV (PC Control)",
    }
    assert any(model.endswith(called[name]) for model in known), known

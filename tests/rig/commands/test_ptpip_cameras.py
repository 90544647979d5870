"""A still camera on the network, from `rig cameras` to a session: simulated ones, served over PTP/IP."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from drivers.clock import SystemClock
from drivers.gige import Network
from drivers.sim.camera.camera import SimulatedCamera
from drivers.sim.ptp.profiles import profile
from drivers.sim.ptp.ptpip import PtpIpServer, listen
from drivers.sim.ptp.responder import Responder
from drivers.sim.rigs import simulate
from drivers.sim.usb.bus import VirtualBus
from drivers.sim.usb.timeline import LiveTimeline
from drivers.sim.usb.virtual_clock import VirtualClock
from imaging.errors import InputError
from imaging.files.raw import read_raw
from rig.cameras.usb_bus import UsbBus
from rig.facade import find_cameras


@pytest.fixture
def served(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """The address of a camera; there is nothing on the USB, and no broadcast."""
    monkeypatch.setattr(
        "rig.cameras.usb_bus.open_bus",
        lambda sim, seed=0, *, rough=False: UsbBus(VirtualBus(VirtualClock()), SystemClock()),
    )
    monkeypatch.setattr("rig.cameras.usb_bus.open_network", lambda sim, addresses=(): Network([], []))
    rig = simulate("toy")
    view = rig.radiance(0, 0)
    timeline = LiveTimeline()
    camera = SimulatedCamera(rig.bodies[0], lambda frame: view)
    with PtpIpServer(Responder(camera, profile("nikon-z6"), timeline), listen(port=0)) as server:
        yield f"ptpip:{server.host}:{server.port}"
    timeline.close()


def test_a_camera_at_an_address_is_listed_described_and_shot_with(rig, tmp_path: Path, served: str) -> None:
    code, out, _ = rig("cameras", "--camera", served)
    assert code == 0
    where = served.removeprefix("ptpip:")
    assert f"SIM-RAW-001  Nikon Corporation Z 6  (PTP/IP {where})\n" in out
    path, session = tmp_path / "RIG.toml", tmp_path / "S"
    assert rig("init", str(path), "--camera", served)[0] == 0
    text = path.read_text()
    assert f'serial = "SIM-RAW-001"\naddress = "{served}"\n' in text
    path.write_text(text.replace("# time = ", "time = "))
    code, out, _ = rig("capture", str(path), str(session), "--bracket=-1,0,1")
    assert (code, "3 of 3 shots" in out) == (0, True)
    shots = [json.loads(line) for line in (session / "shots.jsonl").read_text().splitlines()]
    assert sorted(round(1 / shot["reported"]["time"]) for shot in shots) == [30, 60, 125]
    for shot in shots:
        assert read_raw(session / shot["file"]).metadata.exposure.time == shot["reported"]["time"]


def test_a_camera_at_an_address_is_examined(rig, served: str) -> None:
    code, out, _ = rig("doctor", "--camera", served)
    assert (code, "Nikon Corporation Z 6, serial number SIM-RAW-001;" in out) == (0, True), out
    assert "failed" not in out


def test_a_camera_that_is_not_there_is_told(rig, served: str) -> None:
    with listen(port=0) as there:
        port = there.getsockname()[1]
    code, out, err = rig("cameras", "--camera", f"ptpip:127.0.0.1:{port}")
    assert code == 2
    message = f"PTP/IP 127.0.0.1:{port} cannot be reached (connection refused): switch the camera's Wi-Fi"
    assert out.startswith(message)
    assert f"1 camera could not be asked: {message}" in err
    code, _, err = rig("doctor", "--camera", "ptpip:nowhere")
    assert (code, "--camera 'ptpip:nowhere' has to be gige: or ptpip: and an IPv4 address" in err) == (
        2,
        True,
    )


def test_addresses_are_taken_by_import_rig_too(served: str) -> None:
    (one,) = find_cameras(addresses=[served])
    assert (one.protocol, one.identity and one.identity.model) == ("PTP/IP", "Z 6")
    with pytest.raises(InputError, match="addresses has to be made of gige: or ptpip: and an IPv4 address"):
        find_cameras(addresses=["nowhere"])

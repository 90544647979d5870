"""A camera on the network, from `rig cameras` to a session; it is the fake camera of viva-genicam."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from drivers.clock import SystemClock
from drivers.sim.usb.bus import VirtualBus
from drivers.sim.usb.virtual_clock import VirtualClock
from imaging.files.raw import read_raw
from rig.cameras.usb_bus import UsbBus
from tests.drivers.gige.fakes import own_address, viva_fake
from tests.drivers.gphoto2.conftest import Served
from tests.drivers.gphoto2.conftest import bodies as bodies
from tests.drivers.gphoto2.conftest import serve as serve


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """The camera; there is nothing on the USB."""
    monkeypatch.setattr(
        "rig.cameras.usb_bus.open_bus",
        lambda sim, seed=0, *, rough=False: UsbBus(VirtualBus(VirtualClock()), SystemClock()),
    )
    with viva_fake() as there:
        yield there


def test_a_camera_at_an_address_is_listed_described_and_shot_with(rig, tmp_path: Path, fake: Any) -> None:
    at = f"gige:{fake.ip}"
    code, out, _ = rig("cameras", "--camera", at)
    assert code == 0
    assert f"FAKE-001  viva-genicam FakeGigE  (GigE Vision at GigE {fake.ip})\n    128x96, 16 bit" in out
    path, session = tmp_path / "RIG.toml", tmp_path / "S"
    assert rig("init", str(path), "--camera", at)[0] == 0
    text = path.read_text()
    assert f'serial = "FAKE-001"\naddress = "{at}"\n' in text
    path.write_text(text.replace("# time = ", "time = "))
    code, out, _ = rig("capture", str(path), str(session), "--bracket=-1,0,1")
    assert (code, "3 of 3 shots" in out) == (0, True)
    shots = [json.loads(line) for line in (session / "shots.jsonl").read_text().splitlines()]
    assert len(shots) == 3
    pictures = [read_raw(session / shot["file"]).pixels for shot in shots]
    assert [picture.shape for picture in pictures] == [(96, 128)] * 3
    assert fake.software_triggers() == fake.blocks_sent() == 3


def test_addresses_that_are_none_are_told(rig, tmp_path: Path, fake: Any) -> None:
    for given in (
        "10.0.0.1",
        "gige:camera",
        "gige:10.0.0.256",
        "gige:10.0.0.1:80",
        "ptpip:10.0.0.1:",
        "ptpip:10.0.0.1:99999",
        "usb:1",
    ):
        code, out, err = rig("cameras", "--camera", given)
        assert (code, out) == (2, "")
        assert f"--camera {given!r} has to be gige: or ptpip: and an IPv4 address" in err
    code, _, err = rig("init", str(tmp_path / "R.toml"), "--sim", "toy", "--camera", "gige:10.0.0.1")
    assert code == 2
    assert "leave out --sim, or --camera" in err
    path = tmp_path / "RIG.toml"
    path.write_text('[[camera]]\nname = "a"\nserial = "1"\naddress = "10.0.0.1"\n')
    code, _, err = rig("capture", str(path), str(tmp_path / "S"))
    assert code == 2
    assert 'RIG.toml, line 4: address has to be gige: or ptpip: and an IPv4 address, as "gige:192.168' in err


def test_a_camera_that_does_not_answer_is_missing(rig, tmp_path: Path, fake: Any) -> None:
    code, out, _ = rig("cameras", "--camera", f"gige:{own_address(3)}")
    assert (code, out) == (0, "No camera: rig doctor shows what is missing.\n")


def test_libgphoto2_drives_a_camera_that_is_named_so(
    rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, serve: Callable[..., Served]
) -> None:
    monkeypatch.setattr(
        "rig.cameras.usb_bus.open_bus",
        lambda sim, seed=0, *, rough=False: UsbBus(VirtualBus(VirtualClock()), SystemClock()),
    )
    at = f"gphoto2:ptpip:127.0.0.1:{serve('generic').port}"
    code, out, _ = rig("cameras", "--camera", at)
    assert code == 0
    assert f"SIM-RAW-001  hdr-rig Simulated PTP  (PTP/IP at {at})\n    1/8000 to 30 s, f/2.8 to f/16" in out
    assert "    driver: libgphoto2, as it is named\n" in out
    path = tmp_path / "RIG.toml"
    code, _, err = rig("init", str(path), "--camera", at)
    assert code == 0, err
    assert f'serial = "SIM-RAW-001"\naddress = "{at}"\n' in path.read_text()

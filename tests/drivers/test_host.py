"""Report of `rig doctor` on machines made for the purpose."""

import os
from pathlib import Path
from types import SimpleNamespace

import pytest

from drivers import holders, host
from drivers.errors import CameraClaimed
from drivers.sim.bus_rig import BusRig
from drivers.sim.rigs import simulate
from drivers.sim.usb.bus import Holder
from drivers.usb import RULES, STILL_IMAGE, find
from imaging.errors import CameraError


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> SimpleNamespace:
    """A system with libusb, no camera, and folders of its own."""
    places = SimpleNamespace(
        rules=tmp_path / "rules.d",
        memory=tmp_path / "usbfs_memory_mb",
        nodes=tmp_path / "bus",
        processes=tmp_path / "proc",
        cameras=[],
    )
    places.rules.mkdir()
    monkeypatch.setattr(host, "RULES_FOLDERS", (places.rules,))
    monkeypatch.setattr(host, "MEMORY", places.memory)
    monkeypatch.setattr(holders, "NODES", places.nodes)
    monkeypatch.setattr(holders, "PROCESSES", places.processes)
    monkeypatch.setattr(host, "default_backend", lambda: object())
    monkeypatch.setattr(host, "find", lambda kind, backend: places.cameras if kind.number == 6 else [])
    return places


def finding(name: str) -> host.Finding:
    return next(one for one in host.examine() if one.name == name)


def test_a_machine_without_libusb_says_only_that(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(host, "default_backend", lambda: None)
    (only,) = host.examine()
    assert only.name == "libusb"
    assert "nstall" in only.fix


def test_rules_are_found_or_the_command_that_installs_them_is_told(machine: SimpleNamespace) -> None:
    assert str(host.rules_file()) in finding("udev rules").fix
    assert host.rules_file().is_file()
    (machine.rules / RULES).write_bytes(host.rules_file().read_bytes())
    assert finding("udev rules").fix == ""


@pytest.mark.parametrize(("text", "enough"), [("16", False), ("256", True), ("1000", True), ("0", True)])
def test_little_memory_for_transfers_is_told(machine: SimpleNamespace, text: str, enough: bool) -> None:
    machine.memory.write_text(f"{text}\n")
    assert (finding("USB memory").fix == "") == enough


def test_memory_that_nobody_knows_is_no_fault(machine: SimpleNamespace) -> None:
    assert finding("USB memory").fix == ""
    machine.memory.write_text("much\n")
    assert finding("USB memory").fix == ""


def test_a_bus_that_cannot_be_read_is_told(machine: SimpleNamespace, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(kind: object, backend: object) -> list[object]:
        raise CameraError("no bus here.")

    monkeypatch.setattr(host, "find", refuse)
    assert finding("USB").says == "no bus here."


def test_no_camera_is_no_fault(machine: SimpleNamespace) -> None:
    assert finding("cameras") == host.Finding("cameras", "none on the USB")


def test_who_holds_a_camera_is_named(machine: SimpleNamespace, monkeypatch: pytest.MonkeyPatch) -> None:
    machine.cameras.append(SimpleNamespace(where="USB 001:007", device=SimpleNamespace(bus=1, address=7)))
    node = machine.nodes / "001" / "007"
    node.parent.mkdir(parents=True)
    node.touch()
    assert finding("USB 001:007").says == "may be opened"
    for number, name, link in (
        (41, "gvfsd-gphoto2", node),
        (42, "bash", "/dev/null"),
        (os.getpid(), "us", node),
    ):
        folder = machine.processes / str(number) / "fd"
        folder.mkdir(parents=True)
        (folder.parent / "comm").write_text(f"{name}\n")
        (folder / "3").symlink_to(link)
    assert finding("USB 001:007").says == "held by gvfsd-gphoto2"
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    assert finding("USB 001:007").says == "this user may not open it"
    assert str(host.rules_file()) in finding("USB 001:007").fix


def test_the_error_names_the_program_that_holds_a_camera(machine: SimpleNamespace) -> None:
    bus = BusRig(simulate("toy"))
    camera = find(STILL_IMAGE, bus.backend)[0]
    bus.backend.hold("SIM-RAW-001", Holder.OTHER_PROGRAM)
    with pytest.raises(CameraClaimed, match="held by another program"):
        camera.open()
    node = machine.nodes / "001" / f"{camera.device.address:03d}"
    node.parent.mkdir(parents=True)
    node.touch()
    folder = machine.processes / "77" / "fd"
    folder.mkdir(parents=True)
    (folder.parent / "comm").write_text("darktable\n")
    (folder / "5").symlink_to(node)
    with pytest.raises(CameraClaimed, match="held by darktable: unmount it"):
        camera.open()

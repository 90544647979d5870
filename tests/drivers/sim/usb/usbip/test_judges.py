"""The USB/IP server before programs of others: `usbip` of Linux lists it, Wireshark dissects it."""

import shutil
import socket
import struct
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from drivers import ptp
from drivers.clock import SystemClock
from drivers.sim.usb.usbip.packets import PORT
from drivers.u3v import find_cameras
from imaging.optics.exposure import Exposure
from tests.drivers.u3v.test_camera import shoot

from .attached import AttachedBus
from .conftest import Served, Toy
from .host import Wire

Serve = Callable[..., Served]
Segment = tuple[int, bool, bytes]
"""Client's port, whether it is towards the server, and data."""
_ROOM = 32_000
"""Bytes of a segment: an IP packet holds twice as many."""


def program(name: str) -> str:
    """A judge, also where the administrator's programs are. Skips if it is not installed."""
    path = shutil.which(name) or shutil.which(name, path="/usr/sbin:/sbin")
    if path is None:
        pytest.skip(f"{name} is not installed")
    return path


def test_usbip_lists_the_devices(serve: Serve, toy: Toy) -> None:
    usbip = program("usbip")
    served = serve(toy.vision(), toy.still("nikon-z6"))
    listed = subprocess.run(
        [usbip, "--tcp-port", str(served.server.port), "list", "-r", "127.0.0.1"],
        capture_output=True,
        text=True,
        timeout=30,
        check=True,
    ).stdout
    first, second = (part.splitlines() for part in listed.split(" - 127.0.0.1\n")[1].strip().split("\n\n"))
    assert first[0].strip().startswith("1-1: ")
    assert first[0].endswith("(1209:0453)")
    assert toy.twin.body.serial in first[1]
    assert [line.rpartition(" ")[2] for line in first[2:]] == ["(ef/02/01)", "(ef/05/00)", "(ef/05/02)"]
    assert second[0].strip().startswith("1-2: ")
    assert second[-1].endswith("(06/01/01)")


def segments(wires: list[Wire]) -> Iterator[Segment]:
    """What went over the wires, in pieces that fit into IP packets."""
    for number, wire in enumerate(wires):
        for to_server, data in wire.log:
            for start in range(0, len(data), _ROOM):
                yield 40_000 + number, to_server, data[start : start + _ROOM]


def capture(sent: Iterator[Segment], file: Path) -> None:
    """Write TCP segments, each acknowledging all before it, as a pcap file of raw IPv4."""
    home = socket.inet_aton("127.0.0.1")
    positions: dict[tuple[int, bool], int] = {}
    with file.open("wb") as pcap:
        pcap.write(struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 1 << 17, 101))
        for number, (port, to_server, data) in enumerate(sent):
            ports = (port, PORT) if to_server else (PORT, port)
            at = positions.setdefault((port, to_server), 1)
            back = positions.setdefault((port, not to_server), 1)
            positions[port, to_server] = at + len(data)
            tcp = struct.pack(">HHIIBBHHH", *ports, at, back, 5 << 4, 0x18, 0xFFFF, 0, 0) + data
            packet = struct.pack(">BBHHHBBH", 0x45, 0, 20 + len(tcp), 0, 0, 64, 6, 0) + home + home + tcp
            pcap.write(struct.pack("<IIII", number // 1000, number % 1000, len(packet), len(packet)) + packet)


def judged(wires: list[Wire], file: Path, *names: str) -> tuple[list[str], dict[str, list[str]]]:
    """The packets that tshark calls malformed, in its words, and the values of fields in all packets."""
    capture(segments(wires), file)
    command = [program("tshark"), "-2", "-r", str(file), "-d", f"tcp.port=={PORT},usbip"]

    def lines(*words: str) -> list[str]:
        done = subprocess.run([*command, *words], capture_output=True, text=True, check=True, timeout=60)
        return done.stdout.splitlines()

    wanted = [word for name in names for word in ("-e", name)]
    rows = [line.split("\t") for line in lines("-T", "fields", *wanted)]
    values = {
        name: [value for row in rows for value in row[column].split(",") if value]
        for column, name in enumerate(names)
    }
    return lines("-Y", "_ws.malformed"), values


def test_wireshark_reads_a_vision_camera(serve: Serve, toy: Toy, tmp_path: Path) -> None:
    served = serve(toy.vision())
    wires: list[Wire] = []
    attached = AttachedBus(served.address, wires)
    (camera,) = find_cameras(attached, SystemClock())
    frame = shoot(camera, Exposure(time=1 / 500, iso=100))
    (device,) = attached.devices
    assert device.transfer(0x82, 1024, timeout=0.02) is None  # is unlinked
    assert device.control(0xA1, 0x67, 0, 0, 64)[0] == -32  # stalls
    assert len(device.control(0x80, 6, 15 << 8, 0, 255)[1]) == 22
    camera.close()
    attached.detach()
    malformed, values = judged(
        wires,
        tmp_path / "vision.pcap",
        "usbip.operation",
        "usbip.urb",
        "usbip.status",
        "usb.idVendor",
        "usb.bString",
        "usb.bDescriptorType",
        "usb.bInterfaceSubClass",
        "u3v.gencp.command_id",
        "u3v.stream.block_id",
        "u3v.stream.sizex",
        "u3v.stream.sizey",
    )
    assert malformed == []
    assert {int(code, 16) for code in values["usbip.urb"]} == {1, 2, 3, 4}
    assert set(values["usbip.status"]) == {"0", "-32", "-104"}
    assert set(values["usb.idVendor"]) == {"0x1209"}
    assert set(values["usb.bString"]) == {toy.twin.body.serial}
    # Interface association and endpoint companion among them.
    assert {int(one, 16) for one in values["usb.bDescriptorType"]} == {1, 2, 3, 4, 5, 11, 15, 48}
    assert values["usb.bInterfaceSubClass"] == ["0x05", "0x05"]
    # The reads and writes of memory, and a leader and a trailer.
    assert {int(code, 16) for code in values["u3v.gencp.command_id"]} == {0x0800, 0x0801, 0x0802, 0x0803}
    assert values["u3v.stream.block_id"] == ["1", "1"]
    height, width = frame.pixels.shape
    assert (values["u3v.stream.sizex"], values["u3v.stream.sizey"][0]) == ([str(width)], str(height))


def test_wireshark_reads_a_still_camera(serve: Serve, toy: Toy, tmp_path: Path) -> None:
    served = serve(toy.still("nikon-z6"))
    wires: list[Wire] = []
    attached = AttachedBus(served.address, wires)
    (camera,) = ptp.find_cameras(attached, SystemClock())
    camera.set_exposure(Exposure(time=1 / 60, iso=200))
    camera.close()
    attached.detach()
    malformed, values = judged(wires, tmp_path / "still.pcap", "usbip.urb", "usb.bInterfaceClass")
    assert malformed == []
    assert {1, 3} <= {int(code, 16) for code in values["usbip.urb"]}
    assert values["usb.bInterfaceClass"] == ["0x06"]

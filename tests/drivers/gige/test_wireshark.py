"""Wireshark's dissectors on what host and simulated camera send each other: no packet is malformed."""

import shutil
import socket
import struct
import subprocess
from pathlib import Path

import pytest

from drivers.gige.gvcp import PORT, Action, Command
from drivers.sim.genicam.quirks import Quirk
from drivers.sim.gige.device import GigeDevice
from tests.drivers.shots import together

from .fakes import own_address
from .rows import MakeRow
from .test_actions import join
from .test_sim_device import LABEL, ask, shoot

Packet = tuple[tuple[str, int], tuple[str, int], bytes]
STREAM = 40000
"""The port that frames are written down with."""


def tapped(device: GigeDevice, monkeypatch: pytest.MonkeyPatch) -> list[Packet]:
    """Record the packets of the device from now on: from, to, bytes."""
    heard: list[Packet] = []
    control = (device.address, PORT)
    receive, send, frame = device._receive, device._send, device.sender._send

    def receiving(command: Command, host: tuple[str, int]) -> None:
        heard.append((host, control, command.pack()))
        receive(command, host)

    def sending(answer: bytes, host: tuple[str, int]) -> None:
        heard.append((control, host, answer))
        send(answer, host)

    def streaming(packet: bytes, destination: tuple[str, int]) -> None:
        heard.append(((device.address, STREAM), (destination[0], STREAM), packet))
        frame(packet, destination)

    monkeypatch.setattr(device, "_receive", receiving)
    monkeypatch.setattr(device, "_send", sending)
    monkeypatch.setattr(device.sender, "_send", streaming)
    return heard


def capture(packets: list[Packet], file: Path) -> None:
    """Write them as a pcap file of raw IPv4."""
    with file.open("wb") as pcap:
        pcap.write(struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 1 << 17, 101))
        for number, ((source, sends), (target, takes), data) in enumerate(packets):
            udp = struct.pack(">HHHH", sends, takes, 8 + len(data), 0) + data
            addresses = socket.inet_aton(source) + socket.inet_aton(target)
            packet = struct.pack(">BBHHHBBH", 0x45, 0, 20 + len(udp), 0, 0, 64, 17, 0) + addresses + udp
            pcap.write(struct.pack("<IIII", number, 0, len(packet), len(packet)) + packet)


def judged(packets: list[Packet], file: Path) -> tuple[list[str], list[str]]:
    """Dissection of each packet by tshark, and the packets that it calls malformed, in its words."""
    tshark = shutil.which("tshark")
    if tshark is None:
        pytest.skip("Wireshark (tshark) is not installed")
    capture(packets, file)

    fields = ("_ws.col.Protocol", "_ws.malformed", "_ws.col.Info")
    command = [tshark, "-r", str(file), "-d", f"udp.port=={STREAM},gvsp", "-T", "fields"]
    command += [word for field in fields for word in ("-e", field)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    rows = [line.split("\t") for line in done.stdout.splitlines()]
    return [protocol for protocol, _, _ in rows], [info for _, malformed, info in rows if malformed]


QUIRKS = (
    (),
    (Quirk.CHUNK_PAYLOAD,),
    (Quirk.EXTENDED_CHUNK_PAYLOAD,),
    (Quirk.PENDING,),
    (Quirk.NO_WRITE_MEMORY,),
    (Quirk.EVENTS,),
)


@pytest.mark.parametrize("extended", [False, True])
def test_shots(make_row: MakeRow, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, extended: bool) -> None:
    """By one tshark, which takes longer to begin than to judge."""
    shots = []
    for number, quirks in enumerate(QUIRKS):
        at = (own_address(number),)
        row = make_row(addresses=at, quirks=frozenset(quirks), extended_ids=extended)
        shots.append(tapped(row.devices[0], monkeypatch))
        shoot(row.cameras[0])
        row.cameras[0].close()
    protocols, malformed = judged([packet for shot in shots for packet in shot], tmp_path / "shots.pcap")
    assert malformed == []
    judgements = iter(protocols)
    for quirks, shot in zip(QUIRKS, shots, strict=True):
        assert {next(judgements) for _ in shot} == {"GVCP", "GVSP"}, quirks


def test_action_commands(make_row: MakeRow, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    row = make_row(1)
    packets = tapped(row.devices[0], monkeypatch)
    join(row.cameras)
    assert row.cameras[0].wait_for_time(5.0)
    together(row.cameras, LABEL)
    assert judged(packets, tmp_path / "actions.pcap")[1] == []


REFUSED = {
    "read of no register": (0x80, struct.pack(">I", 0xFFFFFFF0)),
    "read of no memory": (0x84, struct.pack(">IHH", 0xFFFFFFF0, 0, 4)),
    "read that is not aligned": (0x84, struct.pack(">IHH", 0x201, 0, 4)),
    "write without control": (0x82, struct.pack(">II", 0xD04, 1500)),
    "write of memory without control": (0x86, struct.pack(">III", 0x10088, 0, 0)),
    "discovery": (0x02, b""),
    "action of others": (0x100, Action(1, 2, 3).command(1, acknowledge=True).payload),
}


def test_refused_requests(make_row: MakeRow, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    row = make_row()
    packets = tapped(row.devices[0], monkeypatch)
    for number, (name, (code, payload)) in enumerate(REFUSED.items(), start=1):
        ask(row.devices[0].address, Command(code, 7, payload))
        assert len(packets) == 2 * number, name
    assert judged(packets, tmp_path / "refused.pcap")[1] == []

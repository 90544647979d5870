"""The PTP/IP front end: judged by stock gphoto2 on every profile, and by clients that misbehave."""

import os
import shutil
import socket
import struct
import subprocess
from fractions import Fraction
from io import BytesIO
from pathlib import Path

import exifread
import pytest

from drivers.ptp.protocol.codes import Operation, ResponseCode
from drivers.sim.camera.camera import SimulatedCamera
from drivers.sim.ptp.profiles import PROFILES, profile
from drivers.sim.ptp.ptpip import PtpIpServer, listen
from drivers.sim.ptp.responder import Responder
from drivers.sim.rigs import SimulatedRig, simulate
from drivers.sim.usb.timeline import LiveTimeline
from imaging.files.tiff.dng import encode_dng
from tests.drivers.shots import raw_shot

GPHOTO2 = shutil.which("gphoto2")
FAST = dict.fromkeys(PROFILES, "1/250") | {"generic": "0.0040s", "nikon-z6": "0.0040s"}
"""1/250 s as gphoto2 writes it for each profile."""


@pytest.fixture(scope="module")
def rig() -> SimulatedRig:
    rig = simulate("toy")
    rig.radiance(0, 0)  # so that no client waits for the rendering
    return rig


def camera(rig: SimulatedRig) -> SimulatedCamera:
    return SimulatedCamera(rig.bodies[0], lambda frame: rig.radiance(0, frame))


def gphoto2(server: PtpIpServer, folder: Path, *arguments: str) -> str:
    where = f"ptpip:{server.host}:{server.port}:{server.port}"
    assert GPHOTO2 is not None
    done = subprocess.run(
        [GPHOTO2, "--camera", "PTP/IP Camera", "--port", where, *arguments],
        cwd=folder,
        env=os.environ | {"HOME": str(folder), "LC_ALL": "C"},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Error" not in done.stdout + done.stderr, done.stdout + done.stderr
    return done.stdout


@pytest.mark.skipif(GPHOTO2 is None, reason="gphoto2 is not installed: apt-get install gphoto2")
@pytest.mark.parametrize("name", sorted(PROFILES))
def test_gphoto2_summarises_sets_shoots_and_downloads(
    rig: SimulatedRig, timeline: LiveTimeline, tmp_path: Path, name: str
) -> None:
    responder = Responder(camera(rig), profile(name), timeline)
    with PtpIpServer(responder, listen(port=0)) as server:
        summary = gphoto2(server, tmp_path, "--summary")
        assert f"Model: {profile(name).model}" in summary
        assert "Serial Number: SIM-RAW-001" in summary
        assert "Choice: 4 1600" in gphoto2(server, tmp_path, "--get-config", "iso")
        shown = gphoto2(server, tmp_path, "--get-config", "shutterspeed")
        assert f" {FAST[name]}\n" in shown
        assert f"Current: {FAST[name]}\n" not in shown
        settings = ("--set-config", "iso=400", "--set-config", f"shutterspeed={FAST[name]}")
        now = gphoto2(server, tmp_path, *settings, "--get-config", "shutterspeed", "--get-config", "iso")
        assert f"Current: {FAST[name]}\n" in now
        assert "Current: 400\n" in now
        gphoto2(server, tmp_path, "--capture-image-and-download", "--filename", "shot.dng")
    data = (tmp_path / "shot.dng").read_bytes()
    tags = exifread.process_file(BytesIO(data), details=False)
    assert tags["EXIF ExposureTime"].values == [Fraction(1, 250)]
    assert tags["EXIF ISOSpeedRatings"].values == [400]
    assert data == encode_dng(raw_shot(camera(rig), responder.shooting.exposure))


class Client:
    """Packets of PTP/IP on a socket of its own."""

    def __init__(self, server: PtpIpServer) -> None:
        self.link = socket.create_connection((server.host, server.port), timeout=10.0)

    def send(self, kind: int, payload: bytes) -> None:
        self.link.sendall(struct.pack("<II", 8 + len(payload), kind) + payload)

    def receive(self) -> tuple[int, bytes]:
        length, kind = struct.unpack("<II", self.exactly(8))
        return kind, self.exactly(length - 8)

    def exactly(self, size: int) -> bytes:
        data = b""
        while len(data) < size:
            piece = self.link.recv(size - len(data))
            if not piece:
                raise EOFError
            data += piece
        return data

    def run(self, operation: int, transaction: int, *parameters: int) -> int:
        """The response code of an operation without data."""
        self.send(6, struct.pack(f"<IHI{len(parameters)}I", 1, operation, transaction, *parameters))
        while True:
            kind, payload = self.receive()
            if kind == 7:
                return int(struct.unpack_from("<H", payload)[0])


INTRODUCTION = bytes(16) + "me\0".encode("utf-16-le") + struct.pack("<I", 0x10000)


def begin(server: PtpIpServer) -> tuple[Client, Client]:
    """The two connections of a client."""
    commands, events = Client(server), Client(server)
    commands.send(1, INTRODUCTION)
    kind, payload = commands.receive()
    assert kind == 2
    events.send(3, payload[:4])
    assert events.receive() == (4, b"")
    return commands, events


def test_events_go_to_the_client_that_is_there(rig: SimulatedRig, timeline: LiveTimeline) -> None:
    with PtpIpServer(Responder(camera(rig), profile("generic"), timeline), listen(port=0)) as server:
        old = begin(server)
        assert old[0].run(Operation.OPEN_SESSION, 0, 1) == ResponseCode.OK
        for client in old:
            client.link.close()
        new = begin(server)
        assert new[0].run(Operation.OPEN_SESSION, 0, 1) == ResponseCode.OK
        assert new[0].run(Operation.INITIATE_CAPTURE, 1, 0, 0) == ResponseCode.OK
        kind, payload = new[1].receive()
        assert (kind, *struct.unpack_from("<HI", payload)) == (8, 0x4002, 1)
        assert new[1].receive()[0] == 8
        new[1].send(13, b"")
        assert new[1].receive() == (14, b"")
        for client in new:
            client.link.close()


@pytest.mark.parametrize(
    "sent", [b"GET / HTTP/1.0\r\n\r\n", struct.pack("<II", 8, 99), struct.pack("<III", 12, 3, 77)]
)
def test_who_speaks_something_else_is_hung_up_on(
    rig: SimulatedRig, timeline: LiveTimeline, sent: bytes
) -> None:
    with PtpIpServer(Responder(camera(rig), profile("generic"), timeline), listen(port=0)) as server:
        client = Client(server)
        client.link.sendall(sent)
        with pytest.raises((EOFError, ConnectionError)):
            client.receive()
        client.link.close()
        commands, events = begin(server)
        assert commands.run(Operation.OPEN_SESSION, 0, 1) == ResponseCode.OK
        commands.link.close()
        events.link.close()

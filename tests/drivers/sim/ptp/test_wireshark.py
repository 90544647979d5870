"""PTP/IP of both sides, rig's driver and its simulated cameras, judged by Wireshark's dissector."""

import shutil
import socket
import struct
import subprocess
import threading
from contextlib import ExitStack, closing, suppress
from pathlib import Path

import pytest

from drivers.clock import SystemClock
from drivers.errors import CameraRefused
from drivers.ptp import cameras_at
from drivers.ptp.ip.packets import PORT
from drivers.sim.camera.camera import SimulatedCamera
from drivers.sim.ptp.profiles import PROFILES, profile
from drivers.sim.ptp.ptpip import PtpIpServer, listen
from drivers.sim.ptp.responder import Responder
from drivers.sim.rigs import simulate
from drivers.sim.usb.timeline import LiveTimeline
from imaging.optics.exposure import Exposure

TSHARK = shutil.which("tshark")
_RAW_IP = 101
"""Link type of pcap: packets begin with an IP header."""
_MOST = 1400
"""Bytes of a TCP segment."""


class Recorder:
    """Stands between a client and a server, and keeps what each says on each connection, in order."""

    def __init__(self, server: int) -> None:
        self._server, self._listening = server, socket.create_server(("127.0.0.1", 0))
        self.port = self._listening.getsockname()[1]
        self.said: list[tuple[int, bool, bytes]] = []
        self._lock = threading.Lock()
        self._links: list[socket.socket] = []
        threading.Thread(target=self._accept, daemon=True).start()

    def close(self) -> None:
        for link in (self._listening, *self._links):
            with suppress(OSError):
                link.shutdown(socket.SHUT_RDWR)
            link.close()

    def _accept(self) -> None:
        number = 0
        with suppress(OSError):
            while True:
                client, _ = self._listening.accept()
                camera = socket.create_connection(("127.0.0.1", self._server))
                self._links += [client, camera]
                number += 1
                for source, sink, up in ((client, camera, True), (camera, client, False)):
                    threading.Thread(target=self._pass, args=(number, source, sink, up), daemon=True).start()

    def _pass(self, number: int, source: socket.socket, sink: socket.socket, up: bool) -> None:
        with suppress(OSError):
            while data := source.recv(1 << 16):
                with self._lock:
                    self.said.append((number, up, data))
                sink.sendall(data)
        with suppress(OSError):
            sink.shutdown(socket.SHUT_RDWR)


def pcap(said: list[tuple[int, bool, bytes]]) -> bytes:
    """A capture file of TCP segments between a client and port 15740."""
    sent = {(number, up): 1 for number, up, _ in said for up in (True, False)}
    out = [struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 1 << 16, _RAW_IP)]
    for number, up, data in said:
        for at in range(0, len(data), _MOST):
            piece, ports = data[at : at + _MOST], (50000 + number, PORT)
            source, sink = ports if up else ports[::-1]
            tcp = struct.pack(
                ">HHIIBBHHH", source, sink, sent[number, up], sent[number, not up], 0x50, 0x18, 65535, 0, 0
            )
            sent[number, up] += len(piece)
            size = 20 + len(tcp) + len(piece)
            ip = struct.pack(">BBHHHBBH4s4s", 0x45, 0, size, 0, 0, 64, 6, 0, b"\x7f\0\0\1", b"\x7f\0\0\1")
            out.append(struct.pack("<IIII", 1, len(out), size, size) + ip + tcp + piece)
    return b"".join(out)


def dissected(path: Path, *arguments: str) -> list[str]:
    assert TSHARK is not None
    command = [TSHARK, "-r", str(path), "-d", f"tcp.port=={PORT},ptpip", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    return done.stdout.splitlines()


@pytest.mark.skipif(TSHARK is None, reason="tshark is not installed: apt-get install tshark")
@pytest.mark.parametrize("name", PROFILES)
def test_no_packet_is_malformed(name: str, tmp_path: Path) -> None:
    """A shot, and what a camera refuses: an exposure before it is set, an operation that it does not have."""
    rig = simulate("toy")
    view = rig.radiance(0, 0)
    with ExitStack() as stack:
        timeline = stack.enter_context(closing(LiveTimeline()))
        responder = Responder(SimulatedCamera(rig.bodies[0], lambda frame: view), profile(name), timeline)
        server = stack.enter_context(PtpIpServer(responder, listen(port=0)))
        recorder = stack.enter_context(closing(Recorder(server.port)))
        (camera,) = cameras_at([("127.0.0.1", recorder.port)], SystemClock())
        stack.callback(camera.close)
        camera.set_exposure(Exposure(time=1 / 125, f_number=5.6, iso=200))
        camera.arm()
        camera.trigger()
        camera.collect()
        assert camera._body is not None
        with pytest.raises(CameraRefused):
            camera._body.session.run(0x9FFF, 1, 2, 3)
        with pytest.raises(CameraRefused):
            camera._body.session.object_info(0x7FFF0000)
    path = tmp_path / "ptpip.pcap"
    path.write_bytes(pcap(recorder.said))
    assert len(dissected(path, "-Y", "ptpip")) > 20
    assert dissected(path, "-Y", "_ws.malformed || _ws.expert.severity == error") == []


@pytest.mark.skipif(TSHARK is None, reason="tshark is not installed: apt-get install tshark")
def test_the_judge_sees_a_packet_that_is_malformed(tmp_path: Path) -> None:
    path = tmp_path / "ptpip.pcap"
    path.write_bytes(pcap([(1, True, struct.pack("<II", 8 + 20, 1) + bytes(18) + b"ab")]))
    assert len(dissected(path, "-Y", "_ws.malformed")) == 1

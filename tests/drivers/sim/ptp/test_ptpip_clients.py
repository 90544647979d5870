"""The PTP/IP front end and clients that come together, half, or with more than they may send."""

import socket
import struct
import tracemalloc

import numpy as np
import pytest

from drivers.clock import THIS_MACHINE
from drivers.errors import CameraClaimed
from drivers.ptp.ip.connection import connect
from drivers.ptp.protocol.codes import Operation, ResponseCode, SonyOperation, SonyProperty
from drivers.sim.camera.camera import SimulatedCamera
from drivers.sim.ptp import ptpip
from drivers.sim.ptp.profiles import profile
from drivers.sim.ptp.ptpip import PtpIpServer, listen
from drivers.sim.ptp.responder import Responder
from drivers.sim.rigs import simulate
from drivers.sim.usb.timeline import LiveTimeline

from .test_ptpip import INTRODUCTION, Client, begin


def server(timeline: LiveTimeline, name: str = "generic") -> PtpIpServer:
    body = simulate("toy").bodies[0]
    view = np.full((body.optics.lens.height, body.optics.lens.width, 3), 0.2, np.float32)
    return PtpIpServer(
        Responder(SimulatedCamera(body, lambda frame: view), profile(name), timeline), listen(port=0)
    )


def close(*clients: Client) -> None:
    for client in clients:
        client.link.close()


def test_a_second_client_is_refused_until_the_first_has_hung_up(
    timeline: LiveTimeline, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ptpip, "_GRACE", 0.05)
    with server(timeline) as serving:
        first, first_events = begin(serving)
        assert first.run(Operation.OPEN_SESSION, 0, 1) == ResponseCode.OK
        with pytest.raises(CameraClaimed, match="is connected to another program or device"):
            connect(serving.host, serving.port, THIS_MACHINE)
        assert first.run(Operation.GET_NUM_OBJECTS, 1, 0xFFFFFFFF, 0, 0) == ResponseCode.OK
        first_events.send(13, b"")
        assert first_events.receive() == (14, b"")
        monkeypatch.setattr(ptpip, "_GRACE", 10.0)
        close(first, first_events)
        second, second_events = begin(serving)
        assert second.run(Operation.OPEN_SESSION, 0, 1) == ResponseCode.OK
        close(second, second_events)


def test_a_client_takes_the_place_of_one_that_was_half_there(timeline: LiveTimeline) -> None:
    with server(timeline) as serving:
        first = Client(serving)
        first.send(1, INTRODUCTION)
        assert first.receive()[0] == 2
        second, second_events = begin(serving)
        with pytest.raises((EOFError, ConnectionError)):
            first.run(Operation.GET_NUM_OBJECTS, 1, 0xFFFFFFFF, 0, 0)
        assert second.run(Operation.OPEN_SESSION, 0, 1) == ResponseCode.OK
        close(first, second, second_events)


@pytest.mark.parametrize("ends", [False, True])
def test_data_of_no_bytes_are_complete_with_or_without_their_end(timeline: LiveTimeline, ends: bool) -> None:
    """libgphoto2 2.5.30 leaves the EndData out."""
    with server(timeline, "sony-a7m4") as serving:
        client, events = begin(serving)
        assert client.run(Operation.OPEN_SESSION, 0, 1) == ResponseCode.OK
        order = struct.pack("<IHII", 2, SonyOperation.SET_CONTROL_A, 1, SonyProperty.SAVE_DESTINATION)
        client.send(6, order)
        client.send(9, struct.pack("<IQ", 1, 0))
        if ends:
            client.send(12, struct.pack("<I", 1))
        kind, payload = client.receive()
        assert kind == 7
        assert struct.unpack_from("<H", payload)[0] != ResponseCode.OK
        assert client.run(Operation.GET_NUM_OBJECTS, 2, 0xFFFFFFFF, 0, 0) == ResponseCode.OK
        close(client, events)


def test_what_nobody_finishes_costs_no_memory(timeline: LiveTimeline) -> None:
    size, count = 512 << 10, 30
    with server(timeline) as serving:
        tracemalloc.start()
        try:
            links = []
            for _ in range(count):
                link = socket.create_connection((serving.host, serving.port), timeout=10.0)
                links.append(link)
                try:
                    link.sendall(struct.pack("<II", size, 1) + bytes(size - 9))
                    assert link.recv(1) == b""
                except ConnectionError:
                    pass
            peak = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
        assert peak < 4 * size
        client, events = begin(serving)
        assert client.run(Operation.OPEN_SESSION, 0, 1) == ResponseCode.OK
        close(client, events)
        for link in links:
            link.close()

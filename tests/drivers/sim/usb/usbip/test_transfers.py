"""Transfers of a device that is attached over USB/IP: what a host sees is what USB would show it."""

import errno
import struct
from collections.abc import Callable
from types import SimpleNamespace

import pytest

from drivers.sim.usb.bus import VirtualBus
from drivers.sim.usb.port import Device
from drivers.sim.usb.timeline import LiveTimeline
from tests.drivers.sim.usb.test_bus import IN, OUT, PACKET, Echo

from .attached import AttachedBus
from .conftest import Served, Toy
from .host import HEAD, AttachedDevice, Wire

Serve = Callable[..., Served]
TEXT = 3 << 8
GOT = bytes(range(100))


@pytest.fixture
def echo() -> Echo:
    return Echo()


@pytest.fixture
def served(serve: Serve, echo: Echo) -> Served:
    return serve(lambda timeline: echo)


@pytest.fixture
def host(served: Served) -> AttachedDevice:
    return AttachedDevice(served.address, "1-1")


def sends(served: Served, echo: Echo, data: bytes) -> None:
    """The device has data for the host."""
    with served.bus.timeline.lock:
        assert echo.port is not None
        echo.port.send(IN, data)


def fields(descriptor: SimpleNamespace) -> dict[str, object]:
    """What is of the descriptor itself, not of the way to it."""
    ours = ("bus", "address", "speed", "port_number", "port_numbers", "endpoints")
    return {name: value for name, value in vars(descriptor).items() if name not in ours}


@pytest.mark.parametrize("kind", ["echo", "vision", "still"])
def test_descriptors_are_those_of_the_bus(serve: Serve, toy: Toy, kind: str) -> None:
    makers: dict[str, Callable[[LiveTimeline], Device]] = {
        "echo": lambda timeline: Echo(),
        "vision": toy.vision(),
        "still": toy.still("nikon-z6"),
    }
    served = serve(makers[kind])
    attached = AttachedBus(served.address)
    backends: tuple[VirtualBus, AttachedBus] = (served.bus, attached)
    (here,), (there,) = (list(backend.enumerate_devices()) for backend in backends)

    def all_of(backend: VirtualBus | AttachedBus, device: object) -> list[dict[str, object]]:
        """The device, the configuration, and every setting of every interface with its endpoints."""
        configuration = backend.get_configuration_descriptor(device, 0)
        descriptors = [fields(backend.get_device_descriptor(device)), fields(configuration)]
        for number in range(configuration.bNumInterfaces):
            for alternate in range(2):
                try:
                    interface = backend.get_interface_descriptor(device, number, alternate, 0)
                except IndexError:
                    break
                descriptors.append(fields(interface))
                for endpoint in range(interface.bNumEndpoints):
                    descriptors.append(
                        fields(backend.get_endpoint_descriptor(device, endpoint, number, alternate, 0))
                    )
        return descriptors

    assert all_of(attached, there) == all_of(served.bus, here)
    for index, text in enumerate(here.device.description.strings, 1):
        status, sent = there.control(0x80, 6, TEXT + index, 0x0409, 255)
        assert (status, sent[2:].decode("utf-16-le")) == (0, text)
    attached.detach()


def test_a_usb3_vision_camera_is_one_function_of_superspeed(serve: Serve, toy: Toy) -> None:
    host = AttachedDevice(serve(toy.vision()).address, "1-1")
    assert host.speed == 5
    # Interface association: both interfaces from 0 on are a USB3 Vision device.
    assert bytes(host.configuration.extra_descriptors) == bytes((8, 11, 0, 2, 0xEF, 5, 0, 0))
    (control,), (stream,) = host.interfaces[0], host.interfaces[1]
    assert bytes(control.extra_descriptors)[:3] == bytes((20, 0x24, 1))
    for endpoint in (*control.endpoints, *stream.endpoints):
        assert bytes(endpoint.extra_descriptors)[:2] == bytes((6, 48))
    status, capabilities = host.control(0x80, 6, 15 << 8, 0, 255)
    assert (status, capabilities[:2], len(capabilities)) == (0, bytes((5, 15)), 22)
    assert int.from_bytes(capabilities[2:4], "little") == 22
    host.close()


def test_writes_arrive_packet_by_packet(host: AttachedDevice, echo: Echo) -> None:
    assert host.transfer(OUT, GOT) == (0, bytes(100))
    assert host.transfer(OUT, bytes(PACKET)) == (0, bytes(PACKET))
    assert host.result(host.begin(OUT, bytes(PACKET), flags=0x40)) == (0, bytes(PACKET))
    assert host.transfer(OUT, b"") == (0, b"")
    assert echo.got == [GOT[:PACKET], GOT[PACKET:], bytes(PACKET), bytes(PACKET), b"", b""]
    host.close()


def test_a_read_ends_with_a_short_packet_or_when_it_is_full(
    host: AttachedDevice, served: Served, echo: Echo
) -> None:
    reads = [host.begin(IN, room) for room in (512, 512, 64, 512, 512)]
    for data in (GOT, bytes(2 * PACKET), bytes(64) + b"rest"):
        sends(served, echo, data)
    assert host.result(reads[0]) == (0, GOT)
    # Of two full packets, an empty one is the end.
    assert host.result(reads[1]) == (0, bytes(128))
    assert host.result(reads[2]) == (0, bytes(64))
    assert host.result(reads[3]) == (0, b"rest")
    assert host.unlink(reads[4]) == -errno.ECONNRESET
    host.close()


def test_a_short_read_is_an_error_where_the_host_says_so(
    host: AttachedDevice, served: Served, echo: Echo
) -> None:
    """The kernel asks for that when it cuts a read into several, of which a short one ends them all."""
    reads = [host.begin(IN, room, flags=0x201) for room in (PACKET, 512)]
    sends(served, echo, GOT)
    assert host.result(reads[0]) == (0, GOT[:PACKET])
    assert host.result(reads[1]) == (-errno.EREMOTEIO, GOT[PACKET:])
    host.close()


def test_a_read_is_filled_in_parts(host: AttachedDevice, served: Served, echo: Echo) -> None:
    read = host.begin(IN, 3 * PACKET)
    for number in range(3):
        with served.bus.timeline.lock:
            assert echo.port is not None
            echo.port.send_open(IN, bytes((number,)) * PACKET)
        assert host.control(0xA1, 0x67, 0, 0, 64) == (0, b"answer")  # the packet has been taken by then
    assert host.result(read) == (0, b"".join(bytes((number,)) * PACKET for number in range(3)))
    host.close()


def test_a_read_that_is_given_up_leaves_what_comes_to_the_next(
    host: AttachedDevice, served: Served, echo: Echo
) -> None:
    assert host.transfer(IN, 512, timeout=0.02) is None
    sends(served, echo, b"late")
    assert host.transfer(IN, 512) == (0, b"late")
    host.close()


def test_an_unlink_that_is_too_late_follows_the_answer(
    host: AttachedDevice, served: Served, echo: Echo
) -> None:
    read = host.begin(IN, 512)
    sends(served, echo, b"data")
    assert host.result(read) == (0, b"data")
    assert host.unlink(read) == 0
    host.close()


def test_halts_are_told_and_cleared(host: AttachedDevice, served: Served, echo: Echo) -> None:
    waiting = host.begin(IN, 512)
    with served.bus.timeline.lock:
        assert echo.port is not None
        echo.port.halt(IN)
    assert host.result(waiting) == (-errno.EPIPE, b"")
    assert host.transfer(IN, 512) == (-errno.EPIPE, b"")
    assert host.control(0x82, 0, 0, IN, 2) == (0, b"\1\0")
    assert host.control(0x02, 1, 0, IN, b"") == (0, b"")
    assert host.control(0x82, 0, 0, IN, 2) == (0, b"\0\0")
    assert echo.received_events[-1] == "clear 81"
    sends(served, echo, b"again")
    assert host.transfer(IN, 512) == (0, b"again")
    # The host may halt an endpoint, too.
    assert host.control(0x02, 3, 0, OUT, b"") == (0, b"")
    assert host.transfer(OUT, b"x") == (-errno.EPIPE, b"")
    host.close()


def test_a_packet_that_does_not_fit_overflows(host: AttachedDevice, served: Served, echo: Echo) -> None:
    sends(served, echo, bytes(100))
    assert host.transfer(IN, 50) == (-errno.EOVERFLOW, b"")
    assert host.transfer(IN, 64) == (0, bytes(36))
    host.close()


def test_standard_requests(host: AttachedDevice, echo: Echo) -> None:
    assert host.control(0x80, 0, 0, 0, 2) == (0, b"\1\0")
    assert host.control(0x81, 0, 0, 1, 2) == (0, b"\0\0")
    assert host.control(0x80, 8, 0, 0, 1) == (0, b"\1")
    assert host.control(0x81, 10, 0, 1, 1) == (0, b"\0")
    assert host.control(0x01, 11, 1, 1, b"") == (0, b"")
    assert host.control(0x81, 10, 0, 1, 1) == (0, b"\1")
    before = echo.received_events.count("reset")
    assert host.control(0x00, 9, 1, 0, b"") == (0, b"")
    assert echo.received_events.count("reset") == before + 1
    assert host.control(0x81, 10, 0, 1, 1) == (0, b"\0")
    assert host.control(0x80, 6, 1 << 8, 0, 8)[1] == host.control(0x80, 6, 1 << 8, 0, 64)[1][:8]
    assert host.control(0x21, 0x66, 0, 0, b"done") == (0, bytes(4))
    assert echo.received_events[-1] == "done"
    host.close()


@pytest.mark.parametrize(
    "request_",
    [
        (0x80, 6, TEXT + 9, 0, 255),
        (0x80, 6, 15 << 8, 0, 255),  # a BOS, which only SuperSpeed devices have
        (0x80, 6, 2 << 8 | 1, 0, 255),
        (0x00, 9, 2, 0, b""),
        (0x01, 11, 2, 1, b""),
        (0x01, 11, 0, 7, b""),
        (0x81, 10, 0, 7, 1),
        (0x02, 1, 0, 0x8F, b""),
        (0x82, 0, 0, 0x8F, 2),
        (0xA1, 0x99, 0, 0, 64),
        (0x40, 1, 0, 0, b"x"),
    ],
)
def test_a_request_that_the_device_does_not_know_stalls(
    host: AttachedDevice, request_: tuple[int, int, int, int, int | bytes]
) -> None:
    assert host.control(*request_) == (-errno.EPIPE, b"")
    assert host.control(0xA1, 0x67, 0, 0, 3) == (0, b"ans")
    host.close()


def test_an_endpoint_that_is_not_there_stalls(host: AttachedDevice) -> None:
    assert host.transfer(0x8F, 64) == (-errno.EPIPE, b"")
    assert host.transfer(0x0F, b"x") == (-errno.EPIPE, b"")
    host.close()


def test_a_host_that_does_not_read_costs_no_memory(serve: Serve, monkeypatch: pytest.MonkeyPatch) -> None:
    """24 MB of answers are more than the sockets hold."""
    from drivers.sim.usb.usbip import server

    most: list[int] = [0]

    class Counting(server.Transfers):
        def _answer(self, data: bytes) -> None:
            super()._answer(data)
            most[0] = max(most[0], self.backlog)

    class Wordy(Echo):
        def on_control(self, setup: object, data: bytes) -> bytes:
            return bytes(60_000)

    monkeypatch.setattr(server, "Transfers", Counting)
    monkeypatch.setattr(server, "_MOST_DATA", 200_000)
    served = serve(lambda timeline: Wordy())
    host = AttachedDevice(served.address, "1-1")
    with host.changed:  # keeps the answers from being taken in
        numbers = [host.begin(0, 60_000, bytes((0xA1, 1, 0, 0, 0, 0, 0x60, 0xEA))) for _ in range(400)]
    assert [host.result(number) for number in numbers] == 400 * [(0, bytes(60_000))]
    assert 100_000 < most[0] < 300_000
    host.close()


def test_more_reads_than_a_host_has_are_refused(
    host: AttachedDevice, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("drivers.sim.usb.usbip.transfers._MOST_READS", 3)
    reads = [host.begin(IN, 64) for _ in range(4)]
    assert host.result(reads[3]) == (-errno.ENOMEM, b"")
    host.close()


@pytest.mark.parametrize("packets", [0, 0xFFFFFFFF, 5])
def test_isochronous_transfers_are_not_taken(served: Served, packets: int) -> None:
    """Linux sends 0 isochronous packets with other transfers, its documentation has 0xffffffff."""
    wire = Wire(served.address)
    wire.send(HEAD.pack(0x0111, 0x8003, 0) + b"1-1".ljust(32, b"\0"))
    wire.receive(8 + 312)
    head = (1, 7, 1 << 16 | 1, 1, 0)
    wire.send(struct.pack(">10I", *head, 0, 64, 0, packets, 0) + bytes((0xA1, 0x67, 0, 0, 0, 0, 64, 0)))
    if packets == 5:
        assert wire.socket.recv(1) == b""
    else:
        answer = struct.unpack(">5Ii4I8x6s", wire.receive(48 + 6))
        assert answer == (3, 7, 0, 0, 0, 0, 6, 0, packets, 0, b"answer")
    wire.close()

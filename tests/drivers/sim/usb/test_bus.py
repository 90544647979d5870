"""The virtual bus through pyusb: packets, halts, time-outs and hot-plug as libusb shows them."""

import errno
from array import array
from dataclasses import dataclass, field

import pytest
import usb.core
import usb.util
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import CameraClaimed, CameraLost, CameraPermission, CameraTimeout
from drivers.sim.usb.bus import Holder, VirtualBus
from drivers.sim.usb.descriptors import Description, Endpoint, Interface
from drivers.sim.usb.packets import Overflow, PacketQueue
from drivers.sim.usb.port import Port, Setup, Stall
from drivers.sim.usb.virtual_clock import VirtualClock
from drivers.usb import STILL_IMAGE, UsbPipe, find

OUT, IN, EVENTS = 0x02, 0x81, 0x83
PACKET = 64


@dataclass
class Echo:
    """Sends every packet back when an empty or short one ends the transfer; knows one control request."""

    serial: str = "A1"
    got: list[bytes] = field(default_factory=list)
    received_events: list[str] = field(default_factory=list)
    port: Port | None = None

    @property
    def description(self) -> Description:
        pipes = Endpoint(OUT, "bulk", PACKET), Endpoint(IN, "bulk", PACKET), Endpoint(EVENTS, "interrupt", 24)
        spare = Interface(1, (255, 0, 0), ()), Interface(1, (255, 0, 0), (), alternate=1)
        return Description(
            0x1234, 0x0001, ("maker", "echo", self.serial), (Interface(0, (6, 1, 1), pipes), *spare)
        )

    def on_attach(self, port: Port) -> None:
        self.port = port

    def on_bulk_out(self, endpoint: int, packet: bytes) -> None:
        self.got.append(packet)

    def on_control(self, setup: Setup, data: bytes) -> bytes:
        if setup.request == 0x67:
            return b"answer"
        if setup.request == 0x66:
            self.received_events.append(data.decode())
            return b""
        raise Stall

    def on_clear_halt(self, endpoint: int) -> None:
        self.received_events.append(f"clear {endpoint:02x}")

    def on_reset(self) -> None:
        self.received_events.append("reset")


@pytest.fixture
def bus() -> VirtualBus:
    return VirtualBus(VirtualClock())


def plugged(bus: VirtualBus) -> tuple[Echo, usb.core.Device]:
    echo = Echo()
    bus.plug(echo)
    device = usb.core.find(backend=bus)
    assert device is not None
    return echo, device


def refused(number: int) -> "pytest.RaisesExc[usb.core.USBError]":
    return pytest.raises(usb.core.USBError, check=lambda error: error.errno == number)


def test_descriptors_and_strings(bus: VirtualBus) -> None:
    _, device = plugged(bus)
    assert (device.idVendor, device.idProduct, device.bus, device.address) == (0x1234, 1, 1, 1)
    assert (device.manufacturer, device.product, device.serial_number) == ("maker", "echo", "A1")
    settings = [(one.bInterfaceNumber, one.bAlternateSetting) for one in device[0]]
    assert settings == [(0, 0), (1, 0), (1, 1)]
    sizes = {one.bEndpointAddress: (one.bmAttributes, one.wMaxPacketSize) for one in device[0][(0, 0)]}
    assert sizes == {OUT: (2, 64), IN: (2, 64), EVENTS: (3, 24)}
    with pytest.raises(IndexError):
        bus.get_interface_descriptor(device._ctx.dev, 1, 2, 0)
    with refused(errno.EPIPE):
        usb.util.get_string(device, 9)


def test_what_is_written_comes_in_packets(bus: VirtualBus) -> None:
    echo, device = plugged(bus)
    assert device.write(OUT, bytes(150)) == 150
    assert device.write(OUT, b"") == 0
    assert [len(packet) for packet in echo.got] == [64, 64, 22, 0]


@pytest.mark.parametrize(
    ("sent", "size", "reads"),
    [
        (100, 128, [100]),
        (128, 128, [128, 0]),  # a full buffer; the zero-length packet is the next read
        (128, 192, [128]),  # the zero-length packet ends this read
        (200, 128, [128, 72]),
        (0, 64, [0]),
    ],
)
def test_reads_end_with_a_short_packet_or_a_full_buffer(
    bus: VirtualBus, sent: int, size: int, reads: list[int]
) -> None:
    echo, device = plugged(bus)
    assert echo.port is not None
    echo.port.send(IN, bytes(sent))
    assert [len(device.read(IN, size, 100)) for _ in reads] == reads
    with refused(errno.ETIMEDOUT):
        device.read(IN, size, 100)


def test_a_short_packet_divides_transfers(bus: VirtualBus) -> None:
    echo, device = plugged(bus)
    assert echo.port is not None
    echo.port.send(IN, b"header")
    echo.port.send(IN, b"payload")
    assert [bytes(device.read(IN, 512, 100)) for _ in range(2)] == [b"header", b"payload"]


def test_time_outs_are_virtual_and_tell_a_short_count_first(bus: VirtualBus) -> None:
    echo, device = plugged(bus)
    assert echo.port is not None
    with pytest.raises(usb.core.USBTimeoutError) as timeout:
        device.read(IN, 512, 20_000)
    assert (timeout.value.errno, timeout.value.backend_error_code) == (110, -7)
    assert bus.timeline.now() == pytest.approx(20.0)
    echo.port.send_open(IN, bytes(128))
    assert len(device.read(IN, 512, 1000)) == 128
    assert bus.timeline.now() == pytest.approx(21.0, abs=0.01)


def test_a_packet_larger_than_the_buffer_overflows_and_is_lost(bus: VirtualBus) -> None:
    echo, device = plugged(bus)
    assert echo.port is not None
    echo.port.send(IN, bytes(100))
    with refused(errno.EOVERFLOW):
        device.read(IN, 50, 100)
    assert len(device.read(IN, 64, 100)) == 36
    echo.port.send(IN, bytes(100))
    with refused(errno.EOVERFLOW):
        device.read(IN, 80, 100)


def test_a_halt_stays_until_it_is_cleared(bus: VirtualBus) -> None:
    echo, device = plugged(bus)
    assert echo.port is not None
    for endpoint in (IN, OUT):
        echo.port.halt(endpoint)
    assert echo.port.halted() == (OUT, IN)
    for _ in range(2):
        with refused(errno.EPIPE):
            device.read(IN, 64, 100)
        with refused(errno.EPIPE):
            device.write(OUT, b"x", 100)
    device.clear_halt(IN)
    device.ctrl_transfer(0x02, 1, 0, OUT)  # CLEAR_FEATURE(ENDPOINT_HALT), as drivers also send it
    assert echo.received_events == ["clear 81", "clear 02"]
    echo.port.send(IN, b"again")
    assert bytes(device.read(IN, 64, 100)) == b"again"
    assert device.write(OUT, b"x", 100) == 1


def test_control_requests_answer_or_stall(bus: VirtualBus) -> None:
    echo, device = plugged(bus)
    assert bytes(device.ctrl_transfer(0xA1, 0x67, 0, 0, 64)) == b"answer"
    assert bytes(device.ctrl_transfer(0xA1, 0x67, 0, 0, 3)) == b"ans"
    assert device.ctrl_transfer(0x21, 0x66, 0, 0, b"done") == 4
    assert echo.received_events == ["done"]
    with refused(errno.EPIPE):
        device.ctrl_transfer(0xA1, 0x99, 0, 0, 64)
    assert bytes(device.ctrl_transfer(0xA1, 0x67, 0, 0, 64)) == b"answer"


def test_unplugged_and_back_at_a_new_address(bus: VirtualBus) -> None:
    echo, device = plugged(bus)
    assert echo.port is not None
    device.write(OUT, b"x")
    old = echo.port
    old.unplug(replug_after=0.5)
    assert usb.core.find(backend=bus) is None
    calls = (
        lambda: device.read(IN, 64, 100),
        lambda: device.write(OUT, b"x"),
        lambda: device.clear_halt(IN),
        lambda: device.ctrl_transfer(0xA1, 0x67, 0, 0, 64),
        lambda: device.reset(),
    )
    for call in calls:
        with refused(errno.ENODEV):
            call()
    usb.util.dispose_resources(device)
    bus.timeline.sleep(1.0)
    again = usb.core.find(backend=bus)
    assert (again.address, again.serial_number) == (2, "A1")
    old.send(IN, b"into the void")
    assert echo.port is not old
    with refused(errno.ETIMEDOUT):
        again.read(IN, 64, 100)


def test_a_read_that_waits_ends_when_the_cable_comes_out(bus: VirtualBus) -> None:
    _, device = plugged(bus)
    bus.timeline.call_later(0.3, lambda: bus.unplug("A1"))
    with refused(errno.ENODEV):
        device.read(IN, 64, 20_000)
    assert bus.timeline.now() == pytest.approx(0.3)


def test_the_cable_comes_out_at_a_byte(bus: VirtualBus) -> None:
    echo, device = plugged(bus)
    assert echo.port is not None
    echo.port.unplug_at(150, replug_after=0.2)
    echo.port.send(IN, bytes(300))
    assert len(device.read(IN, 128, 100)) == 128
    with refused(errno.ENODEV):
        device.read(IN, 128, 100)
    bus.timeline.sleep(0.2)
    assert usb.core.find(backend=bus).address == 2


def test_reset_empties_queues_and_keeps_the_address(bus: VirtualBus) -> None:
    echo, device = plugged(bus)
    assert echo.port is not None
    echo.port.send(IN, b"old")
    device.reset()
    assert echo.received_events == ["reset"]
    with refused(errno.ETIMEDOUT):
        device.read(IN, 64, 100)
    assert usb.core.find(backend=bus).address == 1


def test_who_holds_a_camera_and_the_pipe_says_so(bus: VirtualBus) -> None:
    echo, _ = plugged(bus)

    def open_pipe() -> UsbPipe:
        return find(STILL_IMAGE, bus)[0].open()

    for holder, error in (
        (Holder.PERMISSIONS, CameraPermission),
        (Holder.OTHER_PROGRAM, CameraClaimed),
        (Holder.KERNEL_DRIVER, CameraClaimed),
    ):
        bus.hold("A1", holder)
        with pytest.raises(error):
            open_pipe()
    device = usb.core.find(backend=bus)
    assert device.is_kernel_driver_active(0)
    device.detach_kernel_driver(0)
    pipe = open_pipe()
    with pytest.raises(CameraClaimed):
        open_pipe()
    assert echo.port is not None
    echo.port.send(IN, b"hello")
    assert pipe.read(pipe.endpoint(into_host=True), 100, 1.0) == b"hello"
    with pytest.raises(CameraTimeout):
        pipe.read(pipe.endpoint(into_host=True, interrupt=True), 24, 0.1)
    bus.unplug("A1")
    with pytest.raises(CameraLost):
        pipe.write(pipe.endpoint(into_host=False), b"x", 1.0)
    pipe.close()
    usb.util.dispose_resources(device)


def test_a_thousand_openings_leave_no_handle(bus: VirtualBus) -> None:
    bus.plug(Echo())
    for _ in range(1000):
        find(STILL_IMAGE, bus)[0].open().close()
    assert bus.open_handles == 0


transfers = st.lists(st.tuples(st.booleans(), st.integers(0, 5 * 8)), max_size=6)


@given(transfers, st.lists(st.integers(1, 60), min_size=1, max_size=8))
def test_runs_act_as_their_packets_would(sent: list[tuple[bool, int]], sizes: list[int]) -> None:
    """The queue against one that holds every packet by itself."""
    queue, packets, count = PacketQueue(8), [], 0
    for closed, length in sent:
        data = bytes((count + index) % 251 for index in range(length))
        count += length
        (queue.put_transfer if closed else queue.put)(data)
        packets += [data[at : at + 8] for at in range(0, length, 8)] or [b""]
        packets += [b""] if closed and length and length % 8 == 0 else []
    for size in sizes:
        wanted, ended, lost = b"", False, False
        while packets and not ended and not lost:
            packet = packets.pop(0)
            lost = len(wanted) + len(packet) > size
            wanted += packet
            ended = len(packet) < 8 or len(wanted) == size
        buffer = array("B", bytes(size))
        if lost:
            with pytest.raises(Overflow):
                queue.take(memoryview(buffer))
        else:
            assert queue.take(memoryview(buffer)) == (len(wanted), ended)
            assert bytes(buffer[: len(wanted)]) == wanted
    assert bool(queue) == bool(packets)

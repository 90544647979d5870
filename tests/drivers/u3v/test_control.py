"""The control channel against a device that does what each test tells it to."""

from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.errors import CameraBusy, CameraProtocol, CameraRefused, CameraTimeout
from drivers.sim.usb.bus import VirtualBus
from drivers.sim.usb.descriptors import Description, Endpoint, Interface
from drivers.sim.usb.port import Port, Setup, Stall
from drivers.sim.usb.virtual_clock import VirtualClock
from drivers.u3v import gencp
from drivers.u3v.control import ControlChannel
from drivers.u3v.gencp import Code, Packet, Status
from drivers.usb import U3V_CONTROL, find
from imaging.errors import CameraError

Act = Callable[["Scripted", Packet], None]


class Scripted:
    """Hands every command to `act`; without one it behaves."""

    description = Description(
        1,
        2,
        ("maker", "model", "serial"),
        (Interface(0, (0xEF, 5, 0), (Endpoint(1, "bulk", 64), Endpoint(0x81, "bulk", 64))),),
    )

    def __init__(self, act: Act | None = None) -> None:
        self.memory = bytearray(range(256)) * 16
        self.commands: list[Packet] = []
        self.act = act or Scripted.behave
        self.port: Port | None = None
        self._received = b""

    def on_attach(self, port: Port) -> None:
        self.port = port

    def on_bulk_out(self, endpoint: int, packet: bytes) -> None:
        self._received += packet
        size = int.from_bytes(self._received[8:10], "little")
        if len(self._received) == gencp.HEADER_SIZE + size:
            command, self._received = Packet.parse(self._received), b""
            self.commands.append(command)
            self.act(self, command)

    def on_control(self, setup: Setup, data: bytes) -> bytes:
        raise Stall

    def on_clear_halt(self, endpoint: int) -> None:
        pass

    def on_reset(self) -> None:
        pass

    def behave(self, command: Packet) -> None:
        if command.code == Code.READ:
            address, size = gencp.parse_read_payload(command.payload)
            self.send(command, Code.READ_ACK, bytes(self.memory[address : address + size]))
        else:
            address, data = gencp.parse_write_payload(command.payload)
            self.memory[address : address + len(data)] = data
            self.send(command, Code.WRITE_ACK, gencp.number_payload(len(data)))

    def send(self, command: Packet, code: int, payload: bytes, status: int = 0, change: int = 0) -> None:
        answer = Packet(status, code, (command.request_id + change) % 0x10000, payload)
        self.raw(answer.pack())

    def raw(self, data: bytes) -> None:
        assert self.port is not None
        self.port.send(0x81, data)


def opened(device: Scripted) -> tuple[ControlChannel, VirtualClock]:
    clock = VirtualClock()
    bus = VirtualBus(clock)
    bus.plug(device)
    (discovered,) = find(U3V_CONTROL, bus)
    return ControlChannel(discovered.open(), clock), clock


@settings(max_examples=40)
@given(st.integers(28, 500), st.integers(16, 500), st.integers(0, 100), st.binary(min_size=1, max_size=900))
def test_memory_is_split_into_what_the_device_takes(
    command: int, answer: int, address: int, data: bytes
) -> None:
    device = Scripted()
    channel, _ = opened(device)
    channel.limit(command, answer, 0.2)
    channel.write(address, data)
    assert channel.read(address, len(data)) == data == device.memory[address : address + len(data)]
    for packet in device.commands:
        assert len(packet.pack()) <= command
        if packet.code == Code.READ:
            assert gencp.parse_read_payload(packet.payload)[1] + gencp.HEADER_SIZE <= answer
    assert len({packet.request_id for packet in device.commands}) == len(device.commands)
    assert all(packet.word == gencp.ACKNOWLEDGE for packet in device.commands)


def test_a_pending_answer_is_waited_for() -> None:
    def slow(device: Scripted, command: Packet) -> None:
        assert device.port is not None
        later = device.port.timeline.call_later
        device.send(command, Code.PENDING_ACK, gencp.number_payload(2000))
        later(1.5, lambda: device.send(command, Code.PENDING_ACK, gencp.number_payload(3000)))
        later(4.0, lambda: device.behave(command))

    device = Scripted(slow)
    channel, clock = opened(device)
    assert channel.read(8, 4) == bytes((8, 9, 10, 11))
    assert 4.0 < clock.now() < 4.1
    assert len(device.commands) == 1


def test_a_device_that_always_asks_for_more_time_is_given_up() -> None:
    def stall(device: Scripted, command: Packet) -> None:
        def again() -> None:
            device.send(command, Code.PENDING_ACK, gencp.number_payload(2000))
            assert device.port is not None
            device.port.timeline.call_later(1.0, again)

        again()

    channel, clock = opened(Scripted(stall))
    with pytest.raises(CameraTimeout):
        channel.read(0, 4)
    assert clock.now() < 5 * 31


def test_late_answers_to_given_up_commands_are_not_taken() -> None:
    def late(device: Scripted, command: Packet) -> None:
        if len(device.commands) == 1:
            assert device.port is not None
            device.port.timeline.call_later(0.6, lambda: device.send(command, Code.READ_ACK, b"old!"))
        else:
            device.behave(command)

    device = Scripted(late)
    channel, clock = opened(device)
    assert channel.read(0, 4) == bytes(range(4))
    clock.sleep(1.0)
    assert channel.read(4, 4) == bytes(range(4, 8))


def test_five_attempts_and_no_more() -> None:
    device = Scripted(lambda device, command: None)
    channel, clock = opened(device)
    with pytest.raises(CameraTimeout, match="does not answer"):
        channel.read(0, 4)
    assert len(device.commands) == 5
    assert clock.now() == pytest.approx(2.5, abs=0.1)


@pytest.mark.parametrize(
    ("status", "kind", "attempts"),
    [
        (Status.TIMEOUT, CameraTimeout, 5),
        (Status.WRITE_PROTECTED, CameraRefused, 1),
        (Status.ACCESS_DENIED, CameraRefused, 1),
        (Status.BAD_ADDRESS, CameraRefused, 1),
        (Status.NOT_IMPLEMENTED, CameraRefused, 1),
        (Status.BAD_PARAMETER, CameraRefused, 1),
        (Status.WRONG_CONFIGURATION, CameraRefused, 1),
        (Status.MISALIGNED, CameraProtocol, 5),
        (Status.BAD_HEADER, CameraProtocol, 5),
        (0x8FFF, CameraProtocol, 5),
    ],
)
def test_statuses_are_our_errors(status: int, kind: type[CameraError], attempts: int) -> None:
    device = Scripted(lambda device, command: device.send(command, Code.WRITE_ACK, b"", status))
    channel, _ = opened(device)
    with pytest.raises(kind, match="USB 001:001"):
        channel.write(0, b"abcd")
    assert len(device.commands) == attempts


def test_a_busy_device_is_asked_for_half_a_second() -> None:
    device = Scripted(lambda device, command: device.send(command, Code.READ_ACK, b"", Status.BUSY))
    channel, clock = opened(device)
    with pytest.raises(CameraBusy, match="USB 001:001"):
        channel.read(0, 4)
    assert 0.5 <= clock.now() < 0.53
    assert len(device.commands) < 30


@pytest.mark.parametrize("pause", [0.004, 0.03, 0.1, 0.45])
def test_a_device_that_was_busy_is_soon_noticed(pause: float) -> None:
    def busy(device: Scripted, command: Packet) -> None:
        assert device.port is not None
        if device.port.timeline.now() < pause:
            device.send(command, Code.READ_ACK, b"", Status.BUSY)
        else:
            device.behave(command)

    channel, clock = opened(Scripted(busy))
    assert channel.read(0, 4) == bytes(range(4))
    assert pause <= clock.now() < pause + 0.022


@pytest.mark.parametrize(
    "act",
    [
        lambda device, command: device.send(command, Code.READ_ACK, b"abc"),
        lambda device, command: device.send(command, Code.READ_ACK, b"abcde"),
        lambda device, command: device.send(command, Code.WRITE_ACK, b"abcd"),
        lambda device, command: device.send(command, 0x0C00, b"abcd"),
        lambda device, command: device.send(command, Code.PENDING_ACK, b"abcd12"),
        lambda device, command: device.raw(b"abcd"),
        lambda device, command: device.raw(bytes(300)),
    ],
)
def test_wrong_answers_are_said_to_be(act: Act) -> None:
    channel, _ = opened(Scripted(act))
    with pytest.raises(CameraProtocol):
        channel.read(0, 4)


def test_an_answer_that_wrote_less_is_refused() -> None:
    act: Act = lambda device, command: device.send(command, Code.WRITE_ACK, gencp.number_payload(2))  # noqa: E731
    channel, _ = opened(Scripted(act))
    with pytest.raises(CameraProtocol, match="wrote 2 bytes of memory instead of 4"):
        channel.write(0, b"abcd")


def test_senseless_limits_are_refused() -> None:
    channel, _ = opened(Scripted())
    with pytest.raises(CameraProtocol, match="packets of 20 and 12 bytes"):
        channel.limit(20, 12, 0.5)


@settings(max_examples=60)
@given(st.lists(st.binary(max_size=80), min_size=5, max_size=5))
def test_random_answers_give_only_our_errors(answers: list[bytes]) -> None:
    waiting = iter(answers)
    channel, clock = opened(Scripted(lambda device, command: device.raw(next(waiting))))
    with pytest.raises(CameraError):
        channel.read(0, 4)
    assert clock.now() < 10

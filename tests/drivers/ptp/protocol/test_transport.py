"""Transactions on packets: how transfers end, what cameras make of them, and the ways back."""

from typing import Any

import pytest

from drivers.errors import CameraLost, CameraProtocol, CameraTimeout
from drivers.ptp.protocol.codec import Command, Data, Event, Header, Response
from drivers.ptp.protocol.codes import UNKNOWN_LENGTH, EventCode, Operation, ResponseCode
from drivers.ptp.protocol.transport import UsbTransport
from drivers.usb import EndpointStalled

OUT, IN, INTERRUPT = 0x02, 0x81, 0x83
GET, SET = Operation.GET_DEVICE_INFO, Operation.SET_DEVICE_PROP_VALUE


@pytest.fixture
def transport(scripted: Any, clock: Any) -> UsbTransport:
    return UsbTransport(scripted.pipe(), clock)


def pixels(size: int) -> bytes:
    return bytes(index % 251 for index in range(size))


@pytest.mark.parametrize("packet", [64, 512, 1024])
@pytest.mark.parametrize("beyond", [-13, -12, -11, 0, 1])
@pytest.mark.parametrize("packets", [1, 2, 513])
def test_data_of_every_length_come_in_and_go_out(
    scripted: Any, clock: Any, packet: int, beyond: int, packets: int
) -> None:
    """Around whole packets, and around whole reads."""
    scripted.device.port.unplug()
    scripted.device.plug(packet)
    transport = UsbTransport(scripted.pipe(), clock)
    payload = pixels(max(0, packets * packet + beyond))
    scripted.scripts[GET] = scripted.sends(payload)
    reply = transport.transact(Command(GET, 1, (7,)))
    assert (reply.data, reply.response) == (payload, Response(ResponseCode.OK, 1))
    assert scripted.commands == [Command(GET, 1, (7,))]
    transport.transact(Command(SET, 2, (0x5007,)), payload)
    assert scripted.data == [payload]
    assert scripted.zero_length == ((len(payload) + 12) % packet == 0)
    assert clock.now() == 0.0


def test_a_response_may_come_where_data_were_due(scripted: Any, transport: UsbTransport) -> None:
    scripted.scripts[GET] = scripted.says(ResponseCode.ACCESS_DENIED)
    reply = transport.transact(Command(GET, 1))
    assert (reply.data, reply.response.code) == (None, ResponseCode.ACCESS_DENIED)


def test_a_leftover_empty_packet_is_read_over_once(scripted: Any, transport: UsbTransport) -> None:
    scripted.scripts[GET] = lambda command, data: [
        Data(GET, 1, b"some").pack(),
        b"",
        *scripted.ok(command),
    ]
    assert transport.transact(Command(GET, 1)).data == b"some"
    scripted.scripts[GET] = lambda command, data: [b"", b""]
    with pytest.raises(CameraProtocol, match="0 bytes"):
        transport.transact(Command(GET, 2))


@pytest.mark.parametrize("size", [0, 1, 499, 500, 501, 5000])
def test_headers_alone_responses_merged_and_lengths_unknown(
    scripted: Any, transport: UsbTransport, size: int
) -> None:
    payload = pixels(size)

    def split(command: Command, data: bytes) -> list[bytes]:
        whole = Data(GET, command.transaction, payload).pack()
        return [whole[:12], *([whole[12:]] if size else []), *scripted.ok(command)]

    def merged(command: Command, data: bytes) -> list[bytes]:
        return [Data(GET, command.transaction, payload).pack() + scripted.ok(command)[0]]

    def both(command: Command, data: bytes) -> list[bytes]:
        whole = merged(command, data)[0]
        return [whole[:12], whole[12:]]

    def unknown(command: Command, data: bytes) -> list[bytes]:
        whole = bytearray(Data(GET, command.transaction, payload).pack())
        whole[:4] = UNKNOWN_LENGTH.to_bytes(4, "little")
        return [bytes(whole), *scripted.ok(command)]

    for number, script in enumerate((split, merged, both, unknown, split), 1):
        if script is unknown and size == 0:
            continue  # a header alone is taken for one whose payload follows
        scripted.scripts[GET] = script
        assert transport.transact(Command(GET, number)).data == payload


def test_a_camera_may_leave_the_last_empty_packet_out(scripted: Any, transport: UsbTransport) -> None:
    def script(command: Command, data: bytes) -> list[bytes]:
        scripted.device.send(Data(GET, command.transaction, pixels(500)).pack(), zlp=False)
        return scripted.ok(command)

    scripted.scripts[GET] = script
    assert transport.transact(Command(GET, 1)).data == pixels(500)


def damage(**changes: int) -> Any:
    """A script whose data container's header is wrong."""

    def script(command: Command, data: bytes) -> list[bytes]:
        true = {"length": 1012, "kind": 2, "code": GET, "transaction": command.transaction}
        head = Header(**(true | changes)).pack()  # type: ignore[arg-type]
        return [head + pixels(1000), Response(ResponseCode.OK, command.transaction).pack()]

    return script


@pytest.mark.parametrize(
    "changes",
    [
        {"length": 900},
        {"length": 1013},
        {"length": 2000},
        {"length": 11},
        {"length": 0xFFFFFFFE},
        {"kind": 4},
        {"kind": 9},
        {"transaction": 77},
    ],
)
def test_nonsense_is_told_and_left_behind(
    scripted: Any, transport: UsbTransport, changes: dict[str, int]
) -> None:
    scripted.scripts[GET] = damage(**changes)
    with pytest.raises(CameraProtocol) as error:
        transport.transact(Command(GET, 5))
    assert transport.recover(error.value, 5)
    assert (0x64, b"\x01\x40\x05\0\0\0") in scripted.device.log
    scripted.scripts[GET] = scripted.sends(b"sense")
    assert transport.transact(Command(GET, 6)).data == b"sense"


def test_padding_that_is_no_container_is_dropped(scripted: Any, transport: UsbTransport) -> None:
    scripted.scripts[GET] = damage(length=1001)
    assert transport.transact(Command(GET, 1)).data == pixels(989)


def test_more_data_than_asked_for_are_refused(scripted: Any, transport: UsbTransport) -> None:
    scripted.scripts[GET] = scripted.sends(pixels(1000))
    with pytest.raises(CameraProtocol, match="at most 999"):
        transport.transact(Command(GET, 1), most=999)


def test_silence_is_a_time_out(scripted: Any, transport: UsbTransport, clock: Any) -> None:
    scripted.scripts[GET] = lambda command, data: []
    with pytest.raises(CameraTimeout):
        transport.transact(Command(GET, 1), timeout=3.0)
    assert clock.now() == pytest.approx(3.0)


def test_a_halt_before_the_first_byte_is_cleared_and_tried_again_once(
    scripted: Any, transport: UsbTransport
) -> None:
    scripted.scripts[GET] = scripted.sends(b"here")
    scripted.device.port.halt(OUT)
    scripted.device.status = (ResponseCode.TRANSACTION_CANCELLED, (OUT,))
    assert transport.transact(Command(GET, 1)).data == b"here"
    assert [one for one in scripted.device.log if one[0] == "clear"] == [("clear", OUT)]
    scripted.device.port.halt(OUT)
    scripted.device.status = (ResponseCode.OK, ())
    scripted.device.clears = False
    with pytest.raises(EndpointStalled):
        transport.transact(Command(GET, 2))
    assert len(scripted.commands) == 1


def test_a_halt_instead_of_the_answer_is_not_tried_again(scripted: Any, transport: UsbTransport) -> None:
    def halt(command: Command, data: bytes) -> list[bytes]:
        scripted.device.port.halt(IN)
        return []

    scripted.scripts[GET] = halt
    with pytest.raises(EndpointStalled) as error:
        transport.transact(Command(GET, 1))
    assert len(scripted.commands) == 1
    assert transport.recover(error.value, 1)
    assert scripted.device.port.halted() == ()
    scripted.scripts[GET] = scripted.sends(b"here")
    assert transport.transact(Command(GET, 2)).data == b"here"


def test_a_camera_that_stays_busy_is_reset(scripted: Any, transport: UsbTransport, clock: Any) -> None:
    error = CameraTimeout("no answer")
    scripted.device.status = (ResponseCode.DEVICE_BUSY, ())
    clock.call_later(1.0, lambda: setattr(scripted.device, "status", (ResponseCode.OK, ())))
    assert transport.recover(error, 1)
    assert scripted.resets == 0
    scripted.device.status = (ResponseCode.DEVICE_BUSY, ())
    scripted.on_reset = lambda: setattr(scripted.device, "status", (ResponseCode.OK, ()))
    assert not transport.recover(error, 1)
    assert scripted.resets == 1
    scripted.device.status = (ResponseCode.DEVICE_BUSY, ())
    scripted.on_reset = lambda: None
    with pytest.raises(CameraLost, match="stuck"):
        transport.recover(error, 1)
    assert clock.now() < 30.0


def test_a_camera_without_class_requests_is_recovered_all_the_same(
    scripted: Any, transport: UsbTransport
) -> None:
    scripted.device.controls = False
    scripted.device.port.halt(IN)
    scripted.device.port.halt(OUT)
    assert transport.recover(EndpointStalled("halted"), 1)
    assert scripted.device.port.halted() == ()


def test_a_pulled_cable_is_told_as_such(scripted: Any, transport: UsbTransport) -> None:
    scripted.device.port.unplug()
    with pytest.raises(CameraLost):
        transport.transact(Command(GET, 1))
    with pytest.raises(CameraLost):
        transport.recover(CameraTimeout("no answer"), 1)
    with pytest.raises(CameraLost):
        transport.events(1.0)


ADDED = Event(EventCode.OBJECT_ADDED, 9, (0x10001,))
COMPLETE = Event(EventCode.CAPTURE_COMPLETE, 9)


def test_events_come_whole_or_in_pieces(scripted: Any, transport: UsbTransport, clock: Any) -> None:
    device = scripted.device
    device.send(ADDED.pack(), INTERRUPT)
    device.send(COMPLETE.pack(), INTERRUPT)
    assert transport.events(1.0) == [ADDED, COMPLETE]
    for at in range(0, 16, 8):
        device.send(ADDED.pack()[at : at + 8], INTERRUPT)
    assert transport.events(1.0) == [ADDED]
    device.send(ADDED.pack()[:8], INTERRUPT)
    assert transport.events(0.1) == []
    clock.call_later(0.05, lambda: device.send(ADDED.pack()[8:], INTERRUPT))
    assert transport.events(0.1) == [ADDED]


def test_what_is_no_event_costs_only_time(scripted: Any, transport: UsbTransport, clock: Any) -> None:
    device = scripted.device
    for rubbish in (bytes(24), b"\xff" * 20, Event(1).pack()[:4] + bytes(10), Data(1, 1, b"12345678").pack()):
        device.send(rubbish, INTERRUPT)
        before = clock.now()
        assert transport.events(0.5) == []
        assert clock.now() > before
    device.port.halt(INTERRUPT)
    assert transport.events(0.5) == []
    device.send(ADDED.pack(), INTERRUPT)
    assert transport.events(0.5) == [ADDED]

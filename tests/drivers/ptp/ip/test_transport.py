"""Transactions over PTP/IP: packets that are whole, late, cut and damaged, events, pings, the way back."""

import struct
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.clock import SystemClock
from drivers.errors import CameraLost, CameraProtocol, CameraTimeout
from drivers.ptp.ip import transport as module
from drivers.ptp.ip.connection import connect
from drivers.ptp.ip.packets import PacketType
from drivers.ptp.ip.transport import IpTransport
from drivers.ptp.protocol.codec import Command, Event, Response
from drivers.ptp.protocol.codes import Operation, ResponseCode

from .peers import Answer, Peer, data, packet, peer, response

GET, SET = Operation.GET_DEVICE_INFO, Operation.SET_DEVICE_PROP_VALUE


@contextmanager
def connected(answer: Answer | None = None) -> Iterator[tuple[Peer, IpTransport]]:
    with peer(answer) as there:
        transport = connect(there.host, there.port, SystemClock())
        try:
            yield there, transport
        finally:
            transport.close()


@pytest.mark.parametrize(
    "pieces", [(b"",), (b"all",), (b"in ", b"several ", b"", b"pieces"), (bytes(200_000),)]
)
@pytest.mark.parametrize("unknown", [False, True])
def test_data_come_in_whole(pieces: tuple[bytes, ...], *, unknown: bool) -> None:
    length = 0xFFFFFFFFFFFFFFFF if unknown else None

    def answer(operation: int, transaction: int) -> bytes:
        return data(transaction, *pieces, length=length) + response(transaction, 0x2001, 5)

    with connected(answer) as (there, transport):
        reply = transport.transact(Command(GET, 3, (1, 2)))
        assert (reply.data, reply.response) == (b"".join(pieces), Response(ResponseCode.OK, 3, (5,)))
        assert there.wait_for(PacketType.OPERATION_REQUEST) == struct.pack("<IHIII", 1, GET, 3, 1, 2)


@pytest.mark.parametrize("size", [0, 1, 65_536, 65_537, 300_000])
def test_data_go_out_whole(size: int) -> None:
    payload = bytes(index % 251 for index in range(size))
    with connected() as (there, transport):
        assert transport.transact(Command(SET, 9), payload).data is None
        head = struct.pack("<I", 9)
        assert there.wait_for(PacketType.START_DATA) == head + struct.pack("<Q", size)
        kinds = {PacketType.DATA, PacketType.END_DATA}
        pieces = [(kind, fields) for _, kind, fields in there.received if kind in kinds]
        assert all(fields[:4] == head for _, fields in pieces)
        assert b"".join(fields[4:] for _, fields in pieces) == payload
        assert [kind for kind, _ in pieces].count(PacketType.END_DATA) == 1


def test_events_come_and_pings_are_answered() -> None:
    with connected() as (there, transport):
        assert there.events is not None
        assert transport.events(0.0) == []
        there.events.sendall(packet(PacketType.PING))
        there.events.sendall(packet(PacketType.EVENT, b"\2\x40"))  # cut off: passed over
        there.events.sendall(packet(PacketType.EVENT, struct.pack("<HIII", 0x4002, 3, 77, 0)))
        assert transport.events(5.0) == [Event(0x4002, 3, (77, 0))]
        there.wait_for(PacketType.PONG)
        assert ("events", PacketType.PONG, b"") in there.received


def test_no_answer_is_cancelled_and_the_next_one_is_heard(monkeypatch: pytest.MonkeyPatch) -> None:
    def answer(operation: int, transaction: int) -> bytes:
        return b"" if transaction == 4 else response(transaction)

    with connected(answer) as (there, transport):
        there.on_cancel = lambda _, transaction: response(transaction, ResponseCode.TRANSACTION_CANCELLED)
        with pytest.raises(CameraTimeout, match=r"^PTP/IP 127\.0\.0\.1:\d+ does not answer: ") as error:
            transport.transact(Command(GET, 4), timeout=0.05)
        assert transport.recover(error.value, 4)
        assert there.wait_for(PacketType.CANCEL) == struct.pack("<I", 4)
        assert transport.transact(Command(GET, 5)).response.code == ResponseCode.OK
        monkeypatch.setattr(module, "_CANCEL_TIMEOUT", 0.05)
        there.on_cancel = None
        with pytest.raises(CameraTimeout) as error:
            transport.transact(Command(GET, 4), timeout=0.05)
        with pytest.raises(CameraLost, match="stays stuck"):
            transport.recover(error.value, 4)


def test_a_packet_that_a_time_out_cut_in_two_is_read_on() -> None:
    parts: list[bytes] = []

    def answer(operation: int, transaction: int) -> bytes:
        whole = response(transaction)
        parts.append(whole[5:])
        return whole[:5]

    with connected(answer) as (there, transport):
        there.on_cancel = lambda _, transaction: parts.pop()
        with pytest.raises(CameraTimeout) as error:
            transport.transact(Command(GET, 1), timeout=0.05)
        assert transport.recover(error.value, 1)
        there.answer = lambda operation, transaction: response(transaction)
        assert transport.transact(Command(GET, 2)).response.code == ResponseCode.OK


@pytest.mark.parametrize(
    "answer",
    [
        lambda operation, transaction: packet(99),
        lambda operation, transaction: packet(PacketType.RESPONSE, b"\1\x20"),
        lambda operation, transaction: response(transaction + 1),
        lambda operation, transaction: data(transaction, b"abc", length=5) + response(transaction),
        lambda operation, transaction: data(transaction, b"abc", length=1) + response(transaction),
        lambda operation, transaction: data(transaction + 1, b"abc") + response(transaction),
        lambda operation, transaction: packet(PacketType.START_DATA, bytes(4)) + response(transaction),
    ],
)
def test_nonsense_in_whole_packets_is_told_and_left_behind(answer: Answer) -> None:
    with connected(answer) as (there, transport):
        there.on_cancel = lambda _, transaction: response(transaction, ResponseCode.TRANSACTION_CANCELLED)
        with pytest.raises(CameraProtocol) as error:
            transport.transact(Command(GET, 5))
        assert transport.recover(error.value, 5)


def test_more_data_than_asked_for_are_refused() -> None:
    def answer(operation: int, transaction: int) -> bytes:
        return data(transaction, bytes(5000)) + response(transaction)

    with connected(answer) as (_, transport), pytest.raises(CameraProtocol, match="at most 4999"):
        transport.transact(Command(GET, 1), most=4999)


def test_who_hangs_up_is_lost() -> None:
    with connected() as (there, transport):
        there.hang_up()
        with pytest.raises(CameraLost, match="hung up"):
            transport.events(5.0)
        with pytest.raises(CameraLost, match="hung up"):
            transport.transact(Command(GET, 1))
        transport.close()


WHOLE = data(1, b"some", b"bytes") + response(1)


@settings(max_examples=150)
@given(
    st.one_of(
        st.binary(max_size=80),
        st.tuples(st.integers(0, len(WHOLE) - 1), st.binary(min_size=1, max_size=4)).map(
            lambda change: WHOLE[: change[0]] + change[1] + WHOLE[change[0] + len(change[1]) :]
        ),
        st.integers(0, len(WHOLE)).map(lambda size: WHOLE[:size]),
    )
)
def test_bytes_of_any_kind_give_camera_errors_alone(sent: bytes) -> None:
    """The peer hangs up after them, so that nobody waits for the rest."""
    with connected(lambda operation, transaction: sent) as (there, transport):
        there.hangs_up = True
        try:
            reply = transport.transact(Command(GET, 1), timeout=5.0, most=1000)
        except (CameraProtocol, CameraTimeout) as error:
            with suppress(CameraLost):
                transport.recover(error, 1)
        except CameraLost:
            pass
        else:
            assert reply.response.transaction == 1
            assert reply.data is None or len(reply.data) <= 1000

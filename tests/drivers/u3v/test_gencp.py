"""Control packets: what is packed is parsed, and what is damaged is said to be."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import CameraProtocol
from drivers.u3v import gencp
from drivers.u3v.gencp import Code, Packet

words = st.integers(0, 0xFFFF)
packets = st.builds(Packet, words, words, words, st.binary(max_size=300))


@given(packets)
def test_packets_survive(packet: Packet) -> None:
    assert Packet.parse(packet.pack()) == packet


def test_a_read_command_byte_by_byte() -> None:
    command = Packet(gencp.ACKNOWLEDGE, Code.READ, 7, gencp.read_payload(0x1D8, 8))
    assert command.pack().hex(" ") == (
        "55 33 56 43 00 40 00 08 0c 00 07 00 d8 01 00 00 00 00 00 00 00 00 08 00"
    )


def test_a_write_command_byte_by_byte() -> None:
    command = Packet(gencp.ACKNOWLEDGE, Code.WRITE, 0x102, gencp.write_payload(0x10, b"\x01\x02"))
    assert command.pack().hex(" ") == "55 33 56 43 00 40 02 08 0a 00 02 01 10 00 00 00 00 00 00 00 01 02"


@given(packets, st.data())
def test_cut_packets_are_refused(packet: Packet, data: st.DataObject) -> None:
    whole = packet.pack()
    with pytest.raises(CameraProtocol):
        Packet.parse(whole[: data.draw(st.integers(0, len(whole) - 1))])


@given(packets, st.binary(min_size=1, max_size=40))
def test_packets_with_more_than_they_announce_are_refused(packet: Packet, surplus: bytes) -> None:
    with pytest.raises(CameraProtocol):
        Packet.parse(packet.pack() + surplus)


@given(packets, st.integers(0, 3), st.integers(1, 255))
def test_another_prefix_is_refused(packet: Packet, place: int, change: int) -> None:
    damaged = bytearray(packet.pack())
    damaged[place] ^= change
    with pytest.raises(CameraProtocol):
        Packet.parse(bytes(damaged))


@given(st.binary(max_size=64))
def test_random_bytes_are_a_packet_or_refused(data: bytes) -> None:
    try:
        packet = Packet.parse(data)
    except CameraProtocol:
        return
    assert packet.pack() == data


@given(st.integers(0, 2**64 - 1), words, st.binary(min_size=1, max_size=50))
def test_payloads_survive(address: int, number: int, data: bytes) -> None:
    assert gencp.parse_read_payload(gencp.read_payload(address, number)) == (address, number)
    assert gencp.parse_write_payload(gencp.write_payload(address, data)) == (address, data)
    assert gencp.parse_number_payload(gencp.number_payload(number)) == number


@given(st.binary(max_size=20))
def test_payloads_of_a_wrong_length_are_refused(data: bytes) -> None:
    for parse, right in (
        (gencp.parse_read_payload, len(data) == 12),
        (gencp.parse_write_payload, len(data) > 8),
        (gencp.parse_number_payload, len(data) == 4),
    ):
        if not right:
            with pytest.raises(CameraProtocol):
                parse(data)

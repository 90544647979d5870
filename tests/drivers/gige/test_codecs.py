"""Datagrams, there and back, and bytes that are none."""

from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import CameraProtocol
from drivers.genicam.archive import parse_url
from drivers.gige import gvcp, gvsp
from drivers.gige.gvcp import Action, Answer, Command, Resend
from drivers.gige.gvsp import Leader, PacketHeader
from drivers.gige.registers import About

u16, u32, u64 = (st.integers(0, 2**bits - 1) for bits in (16, 32, 64))


@given(u16, u16, st.binary(max_size=60), st.integers(0, 255))
def test_commands_survive(code: int, request_id: int, payload: bytes, flags: int) -> None:
    command = Command(code, request_id, payload, flags)
    assert Command.parse(command.pack()) == command


@given(u16, u16, u16, st.binary(max_size=60), st.binary(max_size=4))
def test_answers_survive_padding(
    status: int, code: int, request_id: int, payload: bytes, padding: bytes
) -> None:
    answer = Answer(status, code, request_id, payload)
    assert Answer.parse(answer.pack() + padding) == answer


@given(u32, u32, u32, st.none() | u64, st.booleans())
def test_actions_survive(device: int, group: int, mask: int, time: int | None, acknowledge: bool) -> None:
    action = Action(device, group, mask, time)
    command = action.command(1, acknowledge=acknowledge)
    assert Action.parse(Command.parse(command.pack())) == action
    assert bool(command.flags & gvcp.ACKNOWLEDGE) == acknowledge


@given(st.data(), st.integers(0, 2**24 - 1), st.integers(0, 2**24 - 1), st.booleans())
def test_resends_survive(data: st.DataObject, first: int, last: int, extended: bool) -> None:
    resend = Resend(data.draw(u64 if extended else u16), first, last, extended)
    assert Resend.parse(Command.parse(resend.command(7).pack())) == resend


@given(st.data(), u16, st.sampled_from([1, 2, 3]), st.booleans())
def test_packet_headers_survive(data: st.DataObject, status: int, kind: int, extended: bool) -> None:
    block, number = (
        data.draw(u64 if extended else u16),
        data.draw(u32 if extended else st.integers(0, 0xFFFFFF)),
    )
    header = PacketHeader(status, block, kind, number, extended)
    packed = header.pack()
    assert PacketHeader.parse(packed + b"more") == header
    assert len(packed) == gvsp.header_size(extended)


@given(u64, u64, u32, u32, u32, st.sampled_from([gvsp.IMAGE, gvsp.IMAGE | 0x4000]))
def test_leaders_survive(block: int, stamp: int, code: int, width: int, height: int, kind: int) -> None:
    leader = Leader(block, kind, stamp, code, width, height, 3, 4, 5)
    assert Leader.parse(block, leader.pack()) == leader


@given(st.binary(max_size=300))
def test_random_bytes_are_refused_or_parsed(data: bytes) -> None:
    for parse in (
        Command.parse,
        Answer.parse,
        PacketHeader.parse,
        lambda data: Leader.parse(1, data),
        lambda data: About.parse(data, "10.0.0.1"),
        lambda data: Action.parse(Command(gvcp.Code.ACTION, 1, data)),
        lambda data: Resend.parse(Command(gvcp.Code.RESEND, 1, data)),
        gvcp.parse_number_payload,
    ):
        with suppress(CameraProtocol):
            parse(data)


@pytest.mark.parametrize(
    ("url", "place"),
    [
        ("Local:arv-fake-camera.xml;10000;3e67", ("arv-fake-camera.xml", 0x10000, 0x3E67)),
        ("local:///name.zip;0x8001000;0x33A?SchemaVersion=1.1.0", ("name.zip", 0x8001000, 0x33A)),
        ("LOCAL:a.zip; C0000000; 1f", ("a.zip", 0xC0000000, 0x1F)),
        ("http://maker.example/a.xml", None),
        ("file:///C|program/a.xml", None),
        ("", None),
        ("Local:a.xml;;", None),
    ],
)
def test_urls(url: str, place: tuple[str, int, int] | None) -> None:
    assert parse_url(url) == place


@given(st.text(max_size=40))
def test_random_urls_are_places_or_none(url: str) -> None:
    assert parse_url(url) is None or url[:6].lower() == "local:"

"""Frames from packets that are lost, late, doubled and damaged."""

import random

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import CameraProtocol
from drivers.genicam.session import Frame
from drivers.gige import gvsp
from drivers.gige.assembly import AGAIN, GIVEN_UP, Assembler
from drivers.gige.gvcp import Resend, Status
from drivers.gige.gvsp import Kind, Leader, PacketHeader

SIZE = 200
"""Size of a packet, as the register counts."""


def packets(block: int, payload: bytes, extended: bool) -> list[bytes]:
    """A frame as a device sends it."""
    room = gvsp.room(SIZE, extended)
    parts = [payload[start : start + room] for start in range(0, len(payload), room)]
    carried = [(Kind.LEADER, Leader(block, gvsp.IMAGE, 5, 0x01080001, len(payload), 1).pack())]
    carried += [(Kind.PAYLOAD, part) for part in parts]
    carried += [(Kind.TRAILER, gvsp.trailer(gvsp.IMAGE, 1, len(payload)))]
    return [
        PacketHeader(0, block, kind, number, extended).pack() + data
        for number, (kind, data) in enumerate(carried)
    ]


def feed(assembler: Assembler, data: bytes, now: float) -> Frame | None:
    return assembler.feed(memoryview(data), now)


@given(st.binary(min_size=1, max_size=4000), st.integers(0, 2**32), st.floats(0.0, 0.5), st.booleans())
def test_every_frame_gets_whole_from_a_device_that_sends_again(
    payload: bytes, seed: int, loss: float, extended: bool
) -> None:
    """Packets and requests are lost, come twice and change places, by that share."""
    chance = random.Random(seed)
    sent = packets(9, payload, extended)
    assembler, whole = Assembler(len(payload), SIZE), None
    waiting, now = list(sent), 0.0
    for _ in range(400):
        arriving = [data for data in waiting if chance.random() >= loss or (not now and data is waiting[-1])]
        arriving += [data for data in arriving if chance.random() < loss]
        for index in range(len(arriving) - 1):
            if chance.random() < loss:
                arriving[index : index + 2] = reversed(arriving[index : index + 2])
        for data in arriving:
            frame = feed(assembler, data, now)
            assert frame is None or whole is None
            whole = frame or whole
        if whole is not None:
            break
        now += AGAIN / 4
        wanted = [again for again in assembler.due(now) if chance.random() >= loss]
        waiting = [data for again in wanted for data in sent[again.first : again.last + 1]]
        assert all(again.block == 9 and again.extended == extended for again in wanted)
        assert not assembler.given_up(now) or now > GIVEN_UP
    assert whole is not None
    assert whole.problem is None
    assert whole.payload.tobytes() == payload
    assert (whole.leader.block, whole.leader.timestamp, whole.leader.width) == (9, 5, len(payload))


def test_requests_name_runs_and_are_repeated_at_intervals() -> None:
    sent = packets(1, bytes(2000), False)
    assembler = Assembler(2000, SIZE)
    for number in (0, 1, 4, 5, 9):
        feed(assembler, sent[number], 0.0)
    assert assembler.due(0.001) == []
    runs = [Resend(1, 2, 3, False), Resend(1, 6, 8, False)]
    assert assembler.due(0.003) == runs
    assert assembler.due(0.010) == []
    assert assembler.due(0.003 + AGAIN) == runs
    feed(assembler, sent[7], 0.03)
    assert assembler.due(0.005 + 2 * AGAIN) == [
        Resend(1, 2, 3, False),
        Resend(1, 6, 6, False),
        Resend(1, 8, 8, False),
    ]


def test_the_end_is_asked_for_when_a_frame_falls_silent() -> None:
    sent = packets(1, bytes(2000), False)
    assembler = Assembler(2000, SIZE)
    for data in sent[:-3]:
        feed(assembler, data, 0.0)
    assert assembler.due(AGAIN / 2) == []
    assert assembler.due(AGAIN) == [Resend(1, len(sent) - 3, len(sent) - 1, False)]


def test_a_frame_that_gets_no_further_is_given_up_and_its_late_packets_are_nobodys() -> None:
    sent = packets(1, bytes(2000), False)
    assembler = Assembler(2000, SIZE)
    for data in sent[:3] + sent[4:]:
        feed(assembler, data, 0.0)
    assert assembler.given_up(GIVEN_UP / 2) == []
    (frame,) = assembler.given_up(GIVEN_UP)
    assert frame.problem == "packets were lost, 1 at least, and did not come when asked for again"
    assert feed(assembler, sent[3], GIVEN_UP) is None
    assert assembler.given_up(3 * GIVEN_UP) == []


def test_a_packet_that_the_camera_no_longer_has_ends_the_frame_at_once() -> None:
    sent = packets(1, bytes(2000), False)
    assembler = Assembler(2000, SIZE)
    for data in sent[:3] + sent[4:]:
        assert feed(assembler, data, 0.0) is None
    for status in (Status.NOT_YET_AVAILABLE, Status.TEMPORARILY_UNAVAILABLE):
        assert feed(assembler, PacketHeader(status, 1, Kind.PAYLOAD, 3).pack(), 0.01) is None
    frame = feed(assembler, PacketHeader(Status.REMOVED, 1, Kind.PAYLOAD, 3).pack(), 0.01)
    assert frame is not None
    assert frame.problem == "the camera no longer has packets of it that were lost"


def test_a_frame_smaller_than_it_may_be_is_whole() -> None:
    """Send chunks whose size varies."""
    assembler = Assembler(4000, SIZE)
    frames = [feed(assembler, data, 0.0) for data in packets(3, b"\7" * 1000, False)]
    assert frames[-1] is not None
    assert frames[-1].problem is None
    assert np.array_equal(frames[-1].payload, np.full(1000, 7))


@given(st.integers(0, 2**32), st.booleans())
def test_damaged_packets_are_refused_and_never_more(seed: int, extended: bool) -> None:
    """Bits flip, ends are cut off: what is not refused leaves the assembler in order."""
    chance = random.Random(seed)
    assembler, now = Assembler(1500, SIZE), 0.0
    for block in range(1, 6):
        for data in packets(block, bytes(1500), extended):
            damaged = bytearray(data)
            for _ in range(chance.randrange(3)):
                damaged[chance.randrange(len(damaged))] ^= 1 << chance.randrange(8)
            cut = (
                bytes(damaged[: chance.randrange(len(damaged))]) if chance.random() < 0.1 else bytes(damaged)
            )
            try:
                frame = feed(assembler, cut, now)
            except CameraProtocol:
                continue
            assert frame is None or len(frame.payload) <= 1500
        now += AGAIN
        assert len(assembler.due(now)) < 1000
    assembler.given_up(now + GIVEN_UP)
    for data in packets(99, bytes(range(100)), extended):
        frame = feed(assembler, data, now + 1)
    assert frame is not None
    assert frame.payload.tobytes() == bytes(range(100))

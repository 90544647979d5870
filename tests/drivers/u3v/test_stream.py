"""Leaders, trailers and chunks byte by byte; frames picked out of whatever comes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.errors import CameraLost, CameraProtocol, CameraRefused, CameraTimeout
from drivers.genicam.chunks import ByteOrder, join_chunks, split_chunks
from drivers.sim.u3v.device import STREAM_IN
from drivers.sim.usb.port import Port
from drivers.u3v.session import U3vSession, open_session
from drivers.u3v.stream import IMAGE, Leader, Trailer, TransferPlan

from .conftest import Bench, MakeBench

numbers32, numbers64 = st.integers(0, 2**32 - 1), st.integers(0, 2**64 - 1)
leaders = st.builds(
    Leader,
    numbers64,
    st.integers(0, 0xFFFF),
    numbers64,
    numbers32,
    numbers32,
    numbers32,
    numbers32,
    numbers32,
    st.integers(0, 0xFFFF),
)


@given(leaders)
def test_leaders_survive(leader: Leader) -> None:
    assert Leader.parse(leader.pack()) == leader


def test_a_leader_byte_by_byte() -> None:
    packed = Leader(0x0102, 1, 0x0304, 0x010C0059, 640, 480, 2, 4, 6).pack()
    assert packed.hex(" ") == (
        "55 33 56 4c 00 00 34 00 02 01 00 00 00 00 00 00 00 00 01 00 04 03 00 00 00 00 00 00 "
        "59 00 0c 01 80 02 00 00 e0 01 00 00 02 00 00 00 04 00 00 00 06 00 00 00"
    )


def test_a_trailer_byte_by_byte() -> None:
    trailer = Trailer(7, 0xA100, 0x12345, 480)
    assert trailer.pack().hex(" ") == (
        "55 33 56 54 00 00 20 00 07 00 00 00 00 00 00 00 00 a1 00 00 45 23 01 00 00 00 00 00 e0 01 00 00"
    )
    assert Trailer.parse(trailer.pack()) == trailer


@given(st.binary(max_size=80))
def test_random_bytes_are_neither(data: bytes) -> None:
    assert Leader.parse(data) is None
    assert Trailer.parse(data) is None


@given(st.integers(1, 1 << 26), st.integers(0, 12))
def test_plans_cover_the_payload_in_aligned_transfers(payload: int, exponent: int) -> None:
    alignment = 1 << exponent
    plan = TransferPlan.of(payload, alignment)
    sizes = plan.sizes()
    assert 0 <= sum(sizes) - payload < alignment
    assert all(size % alignment == 0 and 0 < size <= 1 << 20 for size in sizes)


@pytest.mark.parametrize("order", ["little", "big"])
@given(
    image=st.binary(max_size=50),
    more=st.lists(st.tuples(st.integers(0, 2**32 - 1), st.binary(max_size=20)), max_size=4),
)
def test_chunks_survive(order: ByteOrder, image: bytes, more: list[tuple[int, bytes]]) -> None:
    payload = np.frombuffer(join_chunks([(0x1000, image), *more], order), np.uint8)
    image_bytes, chunks = split_chunks(payload, order)
    assert image_bytes.tobytes() == image
    assert chunks == dict(reversed(more))


@given(st.binary(max_size=60))
def test_random_bytes_are_chunks_or_refused(data: bytes) -> None:
    try:
        image, chunks = split_chunks(np.frombuffer(data, np.uint8), "little")
    except CameraProtocol:
        return
    assert len(image) + sum(len(chunk) + 8 for chunk in chunks.values()) <= len(data)


SIZE = 64 * 48


def streaming(bench: Bench) -> tuple[U3vSession, Port]:
    """A session whose stream is on, and the device's end of the cable; frames are 3072 bytes."""
    session = open_session(bench.serial, bench.bus, bench.clock)
    session.nodes.set("PixelFormat", "BayerRG8")
    session.stream.start()
    return session, bench.bus.port(bench.serial)


def payload_of(block: int) -> bytes:
    return np.random.default_rng(block).integers(0, 256, SIZE).astype(np.uint8).tobytes()


def leader_of(block: int) -> bytes:
    return Leader(block, IMAGE, 0, 0x01080009, 64, 48).pack()


def trailer_of(block: int, status: int = 0) -> bytes:
    return Trailer(block, status, SIZE, 48).pack()


def send_frame(port: Port, block: int) -> None:
    port.send(STREAM_IN, leader_of(block))
    port.send_open(STREAM_IN, payload_of(block))
    port.send(STREAM_IN, trailer_of(block))


def test_frames_come_whole_and_in_order(make_bench: MakeBench) -> None:
    session, port = streaming(make_bench())
    for block in (1, 2, 3):
        send_frame(port, block)
    for block in (1, 2, 3):
        frame = session.stream.next_frame(1.0)
        assert (frame.leader.block, frame.problem) == (block, None)
        assert frame.payload.tobytes() == payload_of(block)
    with pytest.raises(CameraTimeout):
        session.stream.next_frame(0.5)


BROKEN = {
    "no trailer": ([leader_of(1), payload_of(1)], "trailer is missing"),
    "no payload": ([leader_of(1), trailer_of(1)], "3072 bytes"),
    "short payload": ([leader_of(1), payload_of(1)[:1500], trailer_of(1)], "1572 bytes"),
    "payload short by packets": ([leader_of(1), payload_of(1)[:2048], b"", trailer_of(1)], "1024 bytes"),
    "only a leader": ([leader_of(1)], "broke off"),
    "trailer of another frame": ([leader_of(1), payload_of(1), trailer_of(9)], "trailer is missing"),
    "lost in the camera": ([leader_of(1), payload_of(1), trailer_of(1, 0xA101)], "0xa101"),
    "more packets instead of a trailer": ([leader_of(1), payload_of(1), bytes(2048)], "trailer is missing"),
    "too much payload": ([leader_of(1), payload_of(1), bytes(700), trailer_of(1)], "trailer is missing"),
}


@pytest.mark.parametrize("what", BROKEN)
def test_a_broken_frame_is_reported_and_the_next_is_whole(make_bench: MakeBench, what: str) -> None:
    packets, problem = BROKEN[what]
    session, port = streaming(make_bench())
    for packet in packets:
        port.send_open(STREAM_IN, packet)
    send_frame(port, 2)
    frame = session.stream.next_frame(1.0)
    assert frame.leader.block == 1
    assert frame.problem is not None
    assert problem in frame.problem
    frame = session.stream.next_frame(1.0)
    assert (frame.leader.block, frame.problem) == (2, None)
    assert frame.payload.tobytes() == payload_of(2)


def test_what_comes_before_a_leader_is_passed_over(make_bench: MakeBench) -> None:
    session, port = streaming(make_bench())
    port.send_open(STREAM_IN, payload_of(1)[:1900])
    port.send(STREAM_IN, trailer_of(1))
    port.send(STREAM_IN, b"")
    send_frame(port, 2)
    frame = session.stream.next_frame(1.0)
    assert (frame.leader.block, frame.problem) == (2, None)


def test_a_payload_that_looks_like_a_leader_is_payload(make_bench: MakeBench) -> None:
    session, port = streaming(make_bench())
    payload = (leader_of(5) + trailer_of(6) + bytes(SIZE))[:SIZE]
    port.send(STREAM_IN, leader_of(1))
    port.send_open(STREAM_IN, payload)
    port.send(STREAM_IN, trailer_of(1))
    frame = session.stream.next_frame(1.0)
    assert frame.problem is None
    assert frame.payload.tobytes() == payload


def test_a_halt_in_a_frame_is_cleared(make_bench: MakeBench) -> None:
    bench = make_bench()
    session, port = streaming(bench)
    port.send(STREAM_IN, leader_of(1))

    def halt() -> None:
        port.halt(STREAM_IN)

    bench.clock.call_later(0.1, halt)
    frame = session.stream.next_frame(1.0)
    assert frame.problem == "the camera halted the stream"
    send_frame(port, 2)
    assert session.stream.next_frame(1.0).problem is None


def test_unplugged_in_a_frame_is_lost(make_bench: MakeBench) -> None:
    session, port = streaming(make_bench())
    port.unplug_at(1000)
    send_frame(port, 1)
    with pytest.raises(CameraLost):
        session.stream.next_frame(1.0)


def test_other_payloads_than_images_are_refused(make_bench: MakeBench) -> None:
    session, port = streaming(make_bench())
    port.send(STREAM_IN, Leader(1, 0x1001, 0, 0, 0, 0).pack())
    with pytest.raises(CameraRefused, match="0x1001"):
        session.stream.next_frame(1.0)


@settings(max_examples=40)
@given(
    st.lists(
        st.one_of(st.binary(max_size=2000), st.sampled_from([leader_of(1), trailer_of(1), payload_of(1)]))
    )
)
def test_whatever_comes_ends_in_time(make_bench: MakeBench, packets: list[bytes]) -> None:
    bench = make_bench()
    session, port = streaming(bench)
    for packet in packets:
        port.send_open(STREAM_IN, packet)
    began = bench.clock.now()
    try:
        frame = session.stream.next_frame(1.0)
        assert frame.leader == Leader.parse(leader_of(1))
        assert frame.problem is not None or frame.payload.size == SIZE
    except CameraTimeout:
        assert leader_of(1) not in packets
    assert bench.clock.now() - began < 1.0 + 5.0

"""The simulated USB3 Vision camera with hosts that stop half way, do not read, or write nonsense."""

import struct
from collections.abc import Sequence
from contextlib import suppress

import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from drivers.errors import CameraRefused
from drivers.genicam.settings import set_exposure
from drivers.sim.genicam.feature_registers import Feature
from drivers.sim.u3v import device
from drivers.sim.u3v.device import CONTROL_OUT, PACKET, STREAM_IN
from drivers.sim.u3v.memory import _MANIFEST, _SBRM, _SIRM
from drivers.u3v import gencp
from drivers.u3v.gencp import Code, Packet
from drivers.u3v.registers import Abrm, Sbrm, Sirm
from drivers.u3v.session import U3vSession, open_session
from imaging.errors import CameraError
from imaging.optics.exposure import Exposure

from .conftest import Bench, MakeBench
from .test_camera import shoot

FAST = Exposure(time=1 / 1000)


def opened(bench: Bench) -> U3vSession:
    session = open_session(bench.serial, bench.bus, bench.clock)
    set_exposure(session.nodes, FAST)
    return session


def run(session: U3vSession, bench: Bench, seconds: float = 0.05) -> None:
    """Stream freely for some time, without reading."""
    session.nodes.set("AcquisitionMode", "Continuous")
    session.stream.start()
    session.nodes.execute("AcquisitionStart")
    bench.clock.sleep(seconds)
    session.nodes.execute("AcquisitionStop")


@pytest.mark.parametrize("by", ["the stream's end", "a cleared halt"])
def test_frames_that_nobody_read_do_not_come_later(make_bench: MakeBench, by: str) -> None:
    bench = make_bench()
    session = opened(bench)
    run(session, bench)
    waiting = bench.bus.port(bench.serial).queue(STREAM_IN)
    assert len(waiting) > 10_000
    if by == "the stream's end":
        session.control.write_number(_SIRM + Sirm.CONTROL, 4, 0)
    else:
        pipe = session.stream._pipe
        pipe.clear_halt(pipe.endpoint(into_host=True))
    assert len(waiting) == 0
    session.control.write_number(_SIRM + Sirm.CONTROL, 4, 0)
    session.nodes.set("PixelFormat", "BayerRG8")
    session.nodes.set("AcquisitionMode", "SingleFrame")
    session.stream.start()
    session.nodes.execute("AcquisitionStart")
    frame = session.stream.next_frame(1.0)
    assert frame.problem is None
    assert frame.leader.pixel_format == session.nodes.number("PixelFormat")
    session.close()


def test_a_host_that_does_not_read_costs_frames_not_memory(
    make_bench: MakeBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(device, "BUFFER", 50_000)
    bench = make_bench()
    session = opened(bench)
    run(session, bench, seconds=0.5)
    port = bench.bus.port(bench.serial)
    assert 50_000 < len(port.queue(STREAM_IN)) < 60_000
    session.close()


@pytest.mark.parametrize(
    ("register", "data"),
    [
        (Feature.WIDTH, struct.pack("<I", 99999)),
        (Feature.WIDTH, struct.pack("<I", 0)),
        (Feature.OFFSET_X, struct.pack("<I", 1)),
        (Feature.PIXEL_FORMAT, struct.pack("<I", 0)),
        (Feature.EXPOSURE_TIME, struct.pack("<d", float("inf"))),
        (Feature.EXPOSURE_TIME, struct.pack("<d", float("nan"))),
        (Feature.EXPOSURE_TIME, struct.pack("<d", -1.0)),
        (Feature.GAIN, struct.pack("<I", 0)),
        (Feature.BLACK_SELECTOR, struct.pack("<I", 4)),
        (Feature.HEIGHT, bytes(100)),
        (Feature.HEIGHT, b"\1"),
    ],
)
def test_a_value_that_its_description_does_not_offer_is_refused(
    make_bench: MakeBench, register: Feature, data: bytes
) -> None:
    bench = make_bench()
    session = opened(bench)
    before = session.control.read(0x10000, 0x140)
    with pytest.raises(CameraRefused, match="does not take that value"):
        session.control.write(register, data)
    assert session.control.read(0x10000, 0x140) == before
    session.close()


def test_transfers_without_number_cost_no_memory(make_bench: MakeBench) -> None:
    bench = make_bench()
    session = opened(bench)
    for register, value in ((Sirm.TRANSFER_SIZE, 1024), (Sirm.TRANSFER_COUNT, 0xFFFFFFFF)):
        session.control.write_number(_SIRM + register, 4, value)
    session.control.write_number(_SIRM + Sirm.CONTROL, 4, 1)
    session.nodes.set("AcquisitionMode", "SingleFrame")
    session.nodes.execute("AcquisitionStart")
    bench.clock.sleep(0.1)
    assert len(bench.bus.port(bench.serial).queue(STREAM_IN)) > 64 * 48
    session.close()


VALUES = st.one_of(
    st.integers(0, 3), st.sampled_from((64, 1000, 0x7FFFFFFF, 0xFFFFFFFF)), st.integers(0, 2**32 - 1)
)
REGISTERS = st.sampled_from((*Feature, *(_SIRM + one for one in Sirm)))
WRITES = st.lists(
    st.tuples(
        REGISTERS,
        st.one_of(
            VALUES.map(lambda value: struct.pack("<I", value)),
            st.floats().map(lambda value: struct.pack("<d", value)),
            st.binary(max_size=16),
        ),
    ),
    max_size=12,
)


@settings(max_examples=40)
@given(writes=WRITES)
def test_whatever_is_written_the_camera_goes_on(
    make_bench: MakeBench, writes: Sequence[tuple[int, bytes]]
) -> None:
    bench = make_bench()
    session = opened(bench)
    for address, data in writes:
        try:
            session.control.write(address, data)
        except CameraError:
            continue
    for register in (Feature.ACQUISITION_START, Feature.TRIGGER_SOFTWARE):
        session.control.write_number(register, 4, 1)
    bench.clock.sleep(0.2)
    session.control.write_number(Feature.ACQUISITION_STOP, 4, 1)
    assert session.control.read(0x144, 64).rstrip(b"\0").decode() == bench.serial
    session.close()


ANYWHERE = st.sampled_from(
    (*Feature, *Abrm, *(_SBRM + one for one in Sbrm), *(_SIRM + one for one in Sirm), _MANIFEST, 0x100000)
)
COMMANDS = st.tuples(
    st.sampled_from((Code.WRITE, Code.WRITE, Code.WRITE, Code.READ, 0x0804, 0xFFFF)),
    ANYWHERE,
    st.integers(-8, 8),
    st.binary(max_size=24),
    st.sampled_from(("as it is", "as it is", "cut off", "a bit wrong", "too long", "starts")),
    st.integers(0, 2**16 - 1),
)


@settings(max_examples=60, phases=[Phase.generate])
@given(commands=st.lists(COMMANDS, max_size=40))
def test_no_packet_ends_the_camera(
    make_bench: MakeBench, commands: Sequence[tuple[int, int, int, bytes, str, int]]
) -> None:
    """Send any code and length, at and across the borders of registers, whole or damaged, read or not."""
    bench = make_bench()
    session = opened(bench)
    before = bytes(session.control.read(Abrm.MANUFACTURER, 64))
    for number, (code, register, off, data, how, dice) in enumerate(commands):
        place = max(register + off, 0)
        payload = gencp.read_payload(place, dice) if code == Code.READ else gencp.write_payload(place, data)
        packet = bytearray(Packet(gencp.ACKNOWLEDGE, code, 1 + number, payload).pack())
        if how == "cut off":
            del packet[dice % len(packet) :]
        elif how == "a bit wrong":
            packet[dice % len(packet)] ^= 1 << dice % 8
        elif how == "too long":
            packet += bytes(2 * PACKET - len(packet))
        with bench.clock.lock:
            for start in range(0, max(len(packet), 1), PACKET):
                bench.device.on_bulk_out(CONTROL_OUT, bytes(packet[start : start + PACKET]))
        bench.clock.sleep(0.001)
        if how == "starts":
            session.control._pipe.clear_halt(session.control._in)
            with suppress(CameraError):
                session.control.write_number(Feature.ACQUISITION_START, 4, 1)
    session.control._pipe.clear_halt(session.control._in)
    session.control.write_number(Feature.ACQUISITION_STOP, 4, 1)
    assert session.control.read(Abrm.MANUFACTURER, 64) == before  # what is for reading only
    session.control.write_number(_SIRM + Sirm.CONTROL, 4, 0)
    session.close()
    camera = bench.camera()
    bench.bus.unplug(bench.serial)
    bench.bus.plug(bench.device)
    assert shoot(camera).pixels.shape == (48, 64)

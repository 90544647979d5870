"""A USB/IP server and its clients: one a device, gone and back, cables pulled out, and nonsense."""

import struct
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from drivers.sim.usb.usbip import server
from tests.drivers.sim.usb.test_bus import IN, Echo

from .conftest import Served, Toy
from .host import HEAD, AttachedDevice, Refused, Wire, bus_ids

Serve = Callable[..., Served]


def serials(count: int) -> list[Callable[[object], Echo]]:
    return [lambda timeline, number=number: Echo(f"S{number}") for number in range(count)]


def test_devices_are_listed_by_their_bus_ids(serve: Serve) -> None:
    served = serve(*serials(3))
    assert served.server.bus_ids() == {"1-1": "S0", "1-2": "S1", "1-3": "S2"}
    kinds = [bytes((6, 1, 1, 0)), bytes((255, 0, 0, 0))]
    assert bus_ids(served.address) == {"1-1": kinds, "1-2": kinds, "1-3": kinds}


def test_one_client_has_a_device_at_a_time(serve: Serve, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "_GRACE", 0.05)
    served = serve(*serials(2))
    first = AttachedDevice(served.address, "1-1")
    with pytest.raises(Refused, match="1"):
        AttachedDevice(served.address, "1-1")
    other = AttachedDevice(served.address, "1-2")  # the other device is free
    assert first.control(0xA1, 0x67, 0, 0, 64) == (0, b"answer")
    with pytest.raises(Refused, match="4"):
        AttachedDevice(served.address, "1-7")
    first.close()
    other.close()


def test_a_client_that_comes_back_finds_the_device_reset(serve: Serve) -> None:
    echo = Echo()
    served = serve(lambda timeline: echo)
    for _ in range(3):
        host = AttachedDevice(served.address, "1-1")
        read = host.begin(IN, 512)
        with served.bus.timeline.lock:
            assert echo.port is not None
            echo.port.send(IN, b"for this client")
        assert host.result(read) == (0, b"for this client")
        host.begin(IN, 512)  # still waits when the client goes
        echo.received_events.clear()
        host.close()
        assert served.bus.timeline.wait(lambda: "reset" in echo.received_events, 10.0)
        with served.bus.timeline.lock:
            echo.port.send(IN, b"left over")
    host = AttachedDevice(served.address, "1-1")
    host.close()


def test_a_device_that_is_unplugged_hangs_up_and_comes_back_by_the_same_name(serve: Serve) -> None:
    served = serve(*serials(2))
    host = AttachedDevice(served.address, "1-1")
    waiting = host.begin(IN, 512)
    served.bus.port("S0").unplug(replug_after=0.05)
    assert host.result(waiting) == (-19, b"")
    host.close()
    assert served.bus.timeline.wait(lambda: "1-1" in served.server.bus_ids(), 10.0)
    again = AttachedDevice(served.address, "1-1")
    assert (again.bus, again.address) == (1, 3)
    again.close()


def test_closing_hangs_up_on_everybody(serve: Serve) -> None:
    served = serve(*serials(1))
    silent = Wire(served.address)
    host = AttachedDevice(served.address, "1-1")
    read = host.begin(IN, 512)
    served.server.close()
    assert host.result(read) == (-19, b"")
    assert silent.socket.recv(1) == b""
    silent.close()
    host.close()
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("usbip")]


@pytest.mark.parametrize(
    "data",
    [
        b"GET / HTTP/1.1\r\n\r\n",
        HEAD.pack(0x0111, 0x8007, 0),
        HEAD.pack(0x0111, 0x8003, 0) + b"1-",
        HEAD.pack(0x0111, 0x8003, 0) + b"\xff" * 32,
        b"",
    ],
)
def test_a_client_that_speaks_something_else_is_dropped(serve: Serve, data: bytes) -> None:
    served = serve(*serials(1))
    wire = Wire(served.address)
    wire.send(data)
    wire.close()
    assert list(bus_ids(served.address)) == ["1-1"]


SETUPS = st.one_of(
    st.binary(min_size=8, max_size=8),
    st.builds(
        lambda kind, request, value, index, length: struct.pack(
            "<BBHHH", kind, request, value, index, length
        ),
        st.sampled_from((0x00, 0x01, 0x02, 0x80, 0x81, 0x82, 0x21, 0xA1, 0x23)),
        st.sampled_from((*range(13), 0x64, 0x66, 0x67)),
        st.sampled_from((0, 1, 2, 4, 0x100, 0x200, 0x300, 0x301, 0xF00, 0xFFFF)),
        st.sampled_from((0, 1, 2, 0x81, 0x82, 0x83, 0x8F, 0xFFFF)),
        st.sampled_from((0, 1, 8, 255, 0xFFFF)),
    ),
)
SUBMITS = st.builds(
    lambda number, into_host, endpoint, flags, length, packets, setup, data: (
        struct.pack(">10I", 1, number, 0x10001, into_host, endpoint, flags, length, 0, packets, 0)
        + setup
        + data
    ),
    st.integers(0, 5),
    st.sampled_from((0, 1, 1, 2)),
    st.sampled_from((0, 1, 2, 3, 15, 16, 2**32 - 1)),
    st.sampled_from((0, 0x40, 0x200, 2**32 - 1)),
    st.sampled_from((0, 1, 20, 64, 1024, 1 << 20, 2**31, 2**32 - 1)),
    st.sampled_from((0, 2**32 - 1, 2**32 - 1, 1)),
    SETUPS,
    st.binary(max_size=64),
)
WELL_MADE = st.builds(
    lambda number, endpoint, setup, data: (
        struct.pack(">10I", 1, number, 0x10001, 0, endpoint, 0, len(data), 0, 0, 0) + setup + data
    ),
    st.integers(0, 5),
    st.sampled_from((0, 1, 2, 15)),
    SETUPS,
    st.binary(max_size=2000),
)
UNLINKS = st.builds(
    lambda number, of, rest: struct.pack(">6I", 2, number, 0x10001, 0, 0, of) + rest,
    st.integers(0, 9),
    st.integers(0, 9),
    st.binary(min_size=24, max_size=24),
)
COMMANDS = st.lists(st.one_of(SUBMITS, WELL_MADE, WELL_MADE, UNLINKS, st.binary(max_size=60)), max_size=12)


@pytest.mark.parametrize("kind", ["vision", "still"])
def test_no_command_ends_the_server(serve: Serve, toy: Toy, kind: str) -> None:
    """Whole, damaged and cut off; every client after it is served as if nothing had been."""
    served = serve(toy.vision() if kind == "vision" else toy.still())

    @settings(max_examples=60, phases=[Phase.generate], suppress_health_check=[HealthCheck.too_slow])
    @given(commands=COMMANDS, cut=st.integers(0, 40))
    def each(commands: Sequence[bytes], cut: int) -> None:
        wire = Wire(served.address)
        wire.send(HEAD.pack(0x0111, 0x8003, 0) + b"1-1".ljust(32, b"\0"))
        assert HEAD.unpack(wire.receive(8))[2] == 0
        wire.receive(312)
        data = b"".join(commands)
        with suppress(OSError):  # it may have hung up
            wire.send(data[: len(data) - cut])
        wire.close()
        host = AttachedDevice(served.address, "1-1")
        assert host.control(0x80, 8, 0, 0, 1) == (0, b"\1")
        host.close()

    each()

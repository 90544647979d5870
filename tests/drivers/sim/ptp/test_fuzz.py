"""Simulated PTP cameras told nonsense: they answer, refuse or halt, and work again after a reset."""

from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from drivers.errors import CameraProtocol, CameraTimeout
from drivers.ptp.protocol.codec import Command, Data
from drivers.ptp.protocol.codes import Operation, ResponseCode
from drivers.sim.ptp.operations import Phase, Request
from drivers.sim.ptp.profiles import PROFILES

Plug = Callable[..., Any]

NUMBERS = st.one_of(
    st.sampled_from(
        [0, 1, 2, 3, 4, 0x500D, 0xD100, 0xD102, 0xD20D, 0xD2C2, 0x10001, 0x10010001, 0xFFFF0001, 2**32 - 1]
    ),
    st.integers(0, 2**32 - 1),
)
FUZZ = settings(
    max_examples=60,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)


@FUZZ
@given(packets=st.lists(st.binary(max_size=512), max_size=6))
def test_random_packets_do_no_lasting_harm(plug: Plug, packets: list[bytes]) -> None:
    host = plug()
    out = host.pipe.endpoint(into_host=False)
    for packet in packets:
        try:
            host.pipe.write(out, packet, 1.0)
            host.pipe.read(host.incoming, 1 << 16, 0.01)
        except (CameraProtocol, CameraTimeout):
            pass
    host.pipe.control_out(0x21, 0x66, 0, b"", 1.0)
    host.transaction = 0
    assert host.run(Operation.OPEN_SESSION, 1).code == ResponseCode.OK


@pytest.mark.parametrize("name", sorted(PROFILES))
def test_random_operations_end_in_a_response(plug: Plug, name: str) -> None:
    host = plug(name)
    handlers = host.responder._handlers
    known = sorted(set(handlers) - {Operation.CLOSE_SESSION})

    @FUZZ
    @given(st.sampled_from([*known, 0x1234]), st.lists(NUMBERS, max_size=5), st.binary(max_size=40))
    def ask(operation: int, parameters: list[int], data: bytes) -> None:
        takes = host.responder.takes_data(operation)
        reply = host.responder.handle(Request(operation, 9, tuple(parameters), data if takes else b""))
        assert Command(reply.code, 9, reply.parameters).pack()
        if reply.data is not None:
            assert handlers[operation].phase is Phase.TO_HOST
            assert Data(operation, 9, reply.data).pack()
        host.clock.sleep(0.05)

    ask()
    host.clock.sleep(60.0)
    assert host.run(Operation.GET_STORAGE_IDS).code == ResponseCode.OK

"""Damaged datagrams on the way: to the simulated camera, and from a camera to us."""

import random
import socket
import struct
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from drivers.clock import SystemClock
from drivers.gige import control as control_module
from drivers.gige.control import ControlChannel
from drivers.gige.gvcp import PORT, Answer, Code, Command
from drivers.gige.registers import Bootstrap
from drivers.sim.genicam.feature_registers import Feature
from imaging.errors import CameraError

from .fakes import own_address
from .rows import MakeRow
from .test_sim_device import shoot

WORD = 0x01020304


@contextmanager
def damaging_device(seed: int) -> Iterator[str]:
    """Answers reads of registers, every second answer with bits flipped, cut off, or late; its address."""
    chance, stop = random.Random(seed), threading.Event()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.bind((own_address(20), PORT))
        link.settimeout(0.1)

        def serve() -> None:
            while not stop.is_set():
                try:
                    data, host = link.recvfrom(2048)
                except TimeoutError:
                    continue
                command = Command.parse(data)
                answer = bytearray(
                    Answer(0, command.code + 1, command.request_id, WORD.to_bytes(4, "big")).pack()
                )
                if chance.random() < 0.5:
                    for _ in range(1 + chance.randrange(3)):
                        answer[chance.randrange(8)] ^= 1 << chance.randrange(8)
                    if chance.random() < 0.3:
                        del answer[chance.randrange(len(answer)) :]
                link.sendto(answer, host)

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        try:
            yield own_address(20)
        finally:
            stop.set()
            thread.join()


def test_damaged_answers_are_asked_for_again_or_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """The head of half of all answers is damaged: what is read is right, or an error of one sentence."""
    monkeypatch.setattr(control_module, "PATIENCE", (0.02,) * 6)
    monkeypatch.setattr(control_module, "_LONGEST_PENDING", 0.05)
    monkeypatch.setattr(control_module, "_LONGEST_BUSY", 0.05)
    right, messages = 0, []
    with damaging_device(3) as address:
        control = ControlChannel(address, SystemClock())
        for _ in range(60):
            try:
                assert control.read_number(0, 4) == WORD
                right += 1
            except CameraError as error:
                messages.append(str(error))
                control._lost = None
        control.close()
    assert right > 40
    assert all(
        message.startswith(f"GigE {address} ") or f"GigE {address}:" in message for message in messages
    )


def test_the_simulated_camera_survives_whatever_comes(make_row: MakeRow) -> None:
    row, chance = make_row(), random.Random(7)
    (device,) = row.devices
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        for _ in range(400):
            code = chance.choice([*Code, chance.randrange(0x10000)])
            payload = chance.randbytes(chance.randrange(40))
            data = bytearray(Command(code, 1 + chance.randrange(9), payload, chance.randrange(256)).pack())
            if chance.random() < 0.5:
                data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
            link.sendto(
                data[: chance.randrange(1, len(data) + 1)] if chance.random() < 0.2 else data,
                (device.address, PORT),
            )
    assert shoot(row.cameras[0]).pixels.shape == (48, 64)


REGISTERS = st.sampled_from(sorted({*map(int, Feature), *map(int, Bootstrap)}))


@settings(max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.lists(
        st.tuples(
            REGISTERS,
            st.integers(-4, 4),
            st.binary(max_size=24),
            st.sampled_from((0x82, 0x86)),
            st.booleans(),
        ),
        max_size=40,
    )
)
def test_no_write_ends_the_simulated_camera(
    make_row: MakeRow, writes: list[tuple[int, int, bytes, int, bool]]
) -> None:
    """Write any length, at and across the borders of registers, from a host that has control."""
    row = make_row()
    (device,) = row.devices
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.settimeout(5)

        def done(number: int, code: int, payload: bytes) -> None:
            link.sendto(Command(code, number, payload).pack(), (device.address, PORT))
            assert Answer.parse(link.recv(2048)).request_id == number

        done(1, Code.WRITE_REGISTER, struct.pack(">II", Bootstrap.CONTROL_PRIVILEGE, 2))
        done(2, Code.WRITE_REGISTER, struct.pack(">II", Bootstrap.STREAM_PORT, link.getsockname()[1] ^ 1))
        for number, (register, off, data, code, starts) in enumerate(writes, 3):
            done(number, code, struct.pack(">I", max(register + off, 0)) + data)
            if starts:
                done(number + 1000, Code.WRITE_REGISTER, struct.pack(">II", Feature.ACQUISITION_START, 1))
        done(5000, Code.READ_REGISTER, struct.pack(">I", Bootstrap.VERSION))
    assert device._serving.is_alive()
    device.close()

"""Simulated PTP cameras on the virtual bus: the makers' ways, and their shutter lists."""

import os
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from drivers.ptp.protocol.codes import (
    CanonOperation,
    CanonProperty,
    DataType,
    NikonOperation,
    NikonProperty,
    Operation,
    PropertyCode,
    ResponseCode,
    SonyOperation,
    SonyProperty,
)
from drivers.sim.camera import shutter
from drivers.sim.faults import Fault, Kind
from drivers.sim.ptp.dials import CANON_TIME, EXPOSURE_TIME, NIKON_TIME, SONY_TIME, TIMES

OK = ResponseCode.OK
Plug = Callable[..., Any]


def test_nikon_sets_exact_times_and_keeps_a_shot_in_memory(plug: Plug) -> None:
    host = plug("nikon-z6")
    assert host.run(NikonOperation.CHANGE_CAMERA_MODE, 1).code == OK
    # 1/6400 s and 1/8000 s are both 1 in hundreds of microseconds.
    assert host.set(NikonProperty.SHUTTER_SPEED, DataType.UINT32, 1 << 16 | 6400) == OK
    assert host.get(Operation.GET_DEVICE_PROP_VALUE, PropertyCode.EXPOSURE_TIME) == struct.pack("<I", 1)
    assert host.responder.shooting.exposure.time == 1 / 6400
    media = NikonOperation.INITIATE_CAPTURE_REC_IN_MEDIA
    host.get(NikonOperation.GET_EVENT)
    assert host.run(media, 0xFFFFFFFF, 1).code == OK
    assert host.run(NikonOperation.DEVICE_READY).code == ResponseCode.DEVICE_BUSY
    host.clock.sleep(1.0)
    assert host.run(NikonOperation.DEVICE_READY).code == OK
    packed = host.get(NikonOperation.GET_EVENT)
    assert struct.unpack("<HHIHI", packed) == (2, 0xC101, 0xFFFF0001, 0xC102, 0)
    assert host.run(media, 0xFFFFFFFF, 1).code == ResponseCode.DEVICE_BUSY
    assert host.get(Operation.GET_OBJECT, 0xFFFF0001)[:4] == b"II*\0"
    assert host.run(Operation.DELETE_OBJECT, 0xFFFF0001).code == OK
    assert host.run(media, 0xFFFFFFFF, 1).code == OK


def canon_records(packed: bytes) -> list[tuple[int, bytes]]:
    records = []
    while packed:
        length, kind = struct.unpack_from("<II", packed)
        records.append((kind, packed[8:length]))
        packed = packed[length:]
    assert records.pop() == (0, b"")
    return records


def test_canon_tells_values_in_records_and_waits_for_the_transfer(plug: Plug) -> None:
    host = plug("canon-eos-6d")
    for operation in (CanonOperation.SET_REMOTE_MODE, CanonOperation.SET_EVENT_MODE):
        assert host.run(operation, 1).code == OK
    records = canon_records(host.get(CanonOperation.GET_EVENT))
    values = {struct.unpack_from("<II", body) for kind, body in records if kind == 0xC189}
    assert {(0xD102, 0x68), (0xD101, 0x28), (0xD103, 0x48), (0xD11C, 2)} <= values  # 1/60 f/4 ISO 100, card
    assert dict(values)[0xD11B] == (1 << 34) // (1 << 25)  # shots: the card over what a picture may need
    assert canon_records(host.get(CanonOperation.GET_EVENT)) == []

    def put(code: int, value: int) -> int:
        packed = struct.pack("<III", 12, code, value)
        return host.run(CanonOperation.SET_DEVICE_PROP_VALUE_EX, data=packed).code

    assert put(CanonProperty.SHUTTER_SPEED, 0x70) == OK
    assert put(CanonProperty.SHUTTER_SPEED, 0x71) == ResponseCode.INVALID_DEVICE_PROP_VALUE
    assert host.responder.shooting.exposure.time == 1 / 125
    assert put(CanonProperty.CAPTURE_DESTINATION, 4) == OK
    assert host.run(CanonOperation.REMOTE_RELEASE_ON, 2).code == ResponseCode.STORE_FULL
    assert host.run(CanonOperation.PC_HDD_CAPACITY, 0x7FFFFFFF, 0x1000, 1).code == OK
    assert host.run(CanonOperation.REMOTE_RELEASE_ON, 1).code == OK
    host.get(CanonOperation.GET_EVENT)
    assert host.run(CanonOperation.REMOTE_RELEASE_ON, 2).code == OK
    host.clock.sleep(1.0)
    (told_shots, shots), (kind, body) = canon_records(host.get(CanonOperation.GET_EVENT))
    handle, _, _, size = struct.unpack_from("<IIII", body)
    room = 0x7FFFFFFF * 0x1000
    assert (told_shots, *struct.unpack("<II", shots)) == (0xC189, 0xD11B, min(room // size, 0xFFFFFFFE))
    assert (kind, body[20:].rstrip(b"\0")) == (0xC186, b"IMG_0001.DNG")
    data = host.get(CanonOperation.GET_PARTIAL_OBJECT, handle, 0, size)
    assert len(data) == size
    assert host.run(CanonOperation.REMOTE_RELEASE_ON, 2).code == ResponseCode.DEVICE_BUSY
    assert host.run(CanonOperation.TRANSFER_COMPLETE, handle).code == OK
    assert host.run(CanonOperation.REMOTE_RELEASE_ON, 2).code == OK


EVERYTHING = SonyOperation.GET_ALL_EXT_DEVICE_PROP_INFO


def sony_value(host: Any, code: int) -> int:
    """A property of the blob."""
    blob = host.get(EVERYTHING)
    at = blob.index(struct.pack("<H", code), 8)
    kind = DataType(struct.unpack_from("<H", blob, at + 2)[0])
    return int.from_bytes(blob[at + 6 + kind.item_size :][: kind.item_size], "little")


def sony(plug: Plug, *faults: Fault) -> Any:
    """A Sony after its handshake."""
    host = plug("sony-a7m4", *faults)
    assert host.run(EVERYTHING).code == ResponseCode.ACCESS_DENIED
    for phase in (1, 2):
        host.get(SonyOperation.SDIO_CONNECT, phase, 0, 0)
    assert host.get(SonyOperation.GET_EXT_DEVICE_INFO, 0xC8, 1)[:2] == b"\xc8\0"
    host.get(SonyOperation.SDIO_CONNECT, 3, 0, 0)
    return host


def test_sony_says_what_is_in_memory_though_the_event_is_lost(plug: Plug) -> None:
    host = sony(plug, Fault(Kind.LOST_EVENT, operation="SET_CONTROL_B", count=2))
    assert host.run(SonyOperation.SET_CONTROL_B, SonyProperty.FULL_PRESS, data=b"\2\0").code == OK
    assert host.events(1.0) == []
    assert sony_value(host, SonyProperty.OBJECT_IN_MEMORY) >= 0x8000


def test_sony_wants_its_handshake_and_frees_memory_when_read(plug: Plug) -> None:
    host = sony(plug)
    packed = struct.pack("<I", 1 << 16 | 250)
    assert host.run(SonyOperation.SET_CONTROL_A, SonyProperty.SHUTTER_SPEED, data=packed).code == OK
    assert sony_value(host, SonyProperty.SHUTTER_SPEED) == 1 << 16 | 250
    assert host.run(SonyOperation.SET_CONTROL_B, SonyProperty.SHUTTER_SPEED, data=b"\xff").code == OK
    assert sony_value(host, SonyProperty.SHUTTER_SPEED) == 1 << 16 | 200
    for button in (SonyProperty.HALF_PRESS, SonyProperty.FULL_PRESS):
        assert host.run(SonyOperation.SET_CONTROL_B, button, data=b"\2\0").code == OK
    assert sony_value(host, SonyProperty.OBJECT_IN_MEMORY) == 0
    assert [(event.code, event.parameters) for event in host.events(1.0)] == [(0xC201, (0xFFFFC001,))]
    assert sony_value(host, SonyProperty.OBJECT_IN_MEMORY) >= 0x8000
    assert len(host.get(Operation.GET_OBJECT, 0xFFFFC001)) > 1000
    assert sony_value(host, SonyProperty.OBJECT_IN_MEMORY) == 0


@pytest.mark.parametrize(
    ("name", "line"), [("nikon-d780", 0x500D), ("nikon-d780", 0xD100), ("nikon-z6", 0xD100)]
)
def test_the_nikon_shutter_lists_are_those_of_real_bodies(name: str, line: int) -> None:
    if "RIG_DATA" not in os.environ:
        pytest.skip("RIG_DATA is not set: the answers of real cameras are not at hand")
    text = (Path(os.environ["RIG_DATA"]) / "ptp" / f"{name}.txt").read_text(errors="replace")
    listed = text.split(f"(0x{line:x}):")[1].split("Enumeration [")[1].split("]")[0]
    numbers = tuple(number for number in map(int, listed.split(",")) if number < 0xFFFFFFFD)
    dial = EXPOSURE_TIME if line == 0x500D else NIKON_TIME
    assert dial.numbers() == numbers


def test_shutter_codes_keep_the_known_points() -> None:
    canon = dict(CANON_TIME.positions)
    assert (canon[0x10], canon[0x38], canon[0x70], canon[0xA0]) == (30.0, 1.0, 1 / 125, 1 / 8000)
    assert len(canon) == len(SONY_TIME.numbers()) == len(TIMES) == len(shutter.APPLIED_TIME)
    assert (SONY_TIME.number(0.4), SONY_TIME.number(30.0)) == (4 << 16 | 10, 300 << 16 | 10)


def test_what_lies_in_memory_goes_with_the_session(plug: Plug) -> None:
    host = plug("nikon-z6")
    shoot = NikonOperation.INITIATE_CAPTURE_REC_IN_SDRAM
    assert host.run(shoot, 0xFFFFFFFF).code == OK
    host.clock.sleep(1.0)
    assert host.run(shoot, 0xFFFFFFFF).code == ResponseCode.DEVICE_BUSY
    host.pipe.close()
    host.bus.port("SIM-RAW-001").unplug(replug_after=0.1)
    host.clock.sleep(0.2)
    host.connect()
    assert host.run(Operation.GET_OBJECT, 0xFFFF0001).code == ResponseCode.INVALID_OBJECT_HANDLE
    assert host.run(shoot, 0xFFFFFFFF).code == OK


@pytest.mark.parametrize("name", ["nikon-z6", "canon-eos-6d"])
def test_events_that_are_asked_for_are_never_lost(plug: Plug, name: str) -> None:
    host = plug(name, Fault(Kind.LOST_EVENT, nth=0))
    operation: int = NikonOperation.INITIATE_CAPTURE_REC_IN_MEDIA
    if name == "canon-eos-6d":
        operation = CanonOperation.REMOTE_RELEASE
        assert host.run(operation).code == ResponseCode.ACCESS_DENIED
        assert host.run(CanonOperation.SET_REMOTE_MODE, 1).code == OK
    host.run(operation, 0xFFFFFFFF)
    assert host.responder.shooting.shooting
    assert host.plan.log == []

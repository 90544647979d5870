"""Records of files by Canon bodies: with sizes of 32 and of 64 bits, with a name and without one."""

import struct
from collections.abc import Callable
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.camera import CameraFile
from drivers.errors import CameraProtocol, CameraRefused
from drivers.ptp.protocol.codes import CanonOperation, Operation, ResponseCode
from drivers.ptp.vendors.canon_records import OBJECTS, unpack_object, unpack_records
from drivers.sim.ptp.canon import Canon
from drivers.sim.ptp.operations import Reply, Request
from drivers.sim.ptp.profiles import PROFILES
from drivers.sim.rigs import SimulatedRig, simulate
from tests.drivers.ptp.test_shots import EXPOSURE, Bench, same, shot

NAME = b"IMG_0001.CR3\0"
R7 = "canon-eos-r7"
READERS = (
    CanonOperation.GET_PARTIAL_OBJECT,
    CanonOperation.GET_PARTIAL_OBJECT_64,
    Operation.GET_PARTIAL_OBJECT,
)


@pytest.fixture(scope="module")
def toy() -> SimulatedRig:
    return simulate("toy")


def test_records_of_32_bits() -> None:
    transfer = struct.pack("<IIIHHIII", 41, 0xC186, 0x91910000, 0xB108, 0, 0, 99, 0) + NAME
    added = struct.pack("<IIIIHHIIIII", 53, 0xC181, 0x1234, 0x20001, 0xB103, 0, 0, 0, 77, 5, 6) + NAME
    data = transfer + added + struct.pack("<II", 8, 0) + b"more"
    first, second = (unpack_object(*record) for record in unpack_records(data))
    assert (first.handle, first.info.format, first.info.size) == (0x91910000, 0xB108, 99)
    assert (second.handle, second.info.storage, second.info.size) == (0x1234, 0x20001, 77)
    assert first.info.filename == second.info.filename == "IMG_0001.CR3"
    for broken in (struct.pack("<II", 7, 1), struct.pack("<II", 99, 1)):
        with pytest.raises(CameraProtocol):
            list(unpack_records(broken))


@pytest.mark.parametrize("size", [77, 0x02A61CD4, 5 << 30])
def test_records_of_64_bits(size: int) -> None:
    transfer = struct.pack("<IIIHHIQ", 41, 0xC1A9, 0x91910000, 0xB108, 0, 0, size) + NAME
    added = struct.pack("<IIIIHHIIQII", 57, 0xC1A7, 0x1234, 0x20001, 0xB108, 0, 0, 0, size, 5, 6) + NAME
    first, second = (unpack_object(*record) for record in unpack_records(transfer + added))
    assert (first.handle, first.info.format, first.info.size) == (0x91910000, 0xB108, size)
    assert (second.handle, second.info.storage, second.info.size) == (0x1234, 0x20001, size)
    assert first.info.filename == second.info.filename == "IMG_0001.CR3"


def test_a_record_of_an_r5_mark_ii() -> None:
    """Read a record that one of its users printed: a picture of 44,440,788 bytes without a name."""
    payload = bytes.fromhex("40c03214 08b10000 00000000 d41ca602 00000000 00c03214 06000000")
    file = unpack_object(0xC1B8, payload)
    assert (file.handle, file.info.format, file.info.size) == (0x1432C040, 0xB108, 44_440_788)
    assert file.info.filename == "1432C040.CR3"


@given(st.sampled_from(sorted(OBJECTS)), st.binary(max_size=64))
def test_a_record_that_is_cut_off_is_told(kind: int, payload: bytes) -> None:
    try:
        unpack_object(kind, payload)
    except CameraProtocol:
        return
    assert len(payload) >= 16


@pytest.mark.parametrize("records", ["64", "64 long names"])
@pytest.mark.parametrize("jpeg", [False, True])
def test_a_body_of_the_r_generation_shoots(
    records: str, jpeg: bool, toy: SimulatedRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(PROFILES, R7, replace(PROFILES[R7], records=records, jpeg=jpeg))
    bench = Bench(toy, R7)
    truth = bench.truth(EXPOSURE)
    for _ in range(2):
        began = bench.clock.now()
        frame = shot(bench.camera, EXPOSURE)
        assert bench.clock.now() - began < 2.0
        assert isinstance(frame, CameraFile)
        assert (frame.suffix, frame.developed is not None) == (
            ".cr3" if records == "64 long names" else ".dng",
            jpeg,
        )
        assert (frame.width, frame.metadata.exposure) == (64, EXPOSURE)
    assert same(shot(Bench(toy, R7).camera, EXPOSURE), truth)


def test_so_does_one_that_keeps_its_pictures_on_a_card(
    toy: SimulatedRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A body whose destination stays at its card tells of them by the other kind of record."""
    monkeypatch.setattr(Canon, "_to_host", False)
    for records in ("32", "64", "64 long names"):
        monkeypatch.setitem(PROFILES, R7, replace(PROFILES[R7], records=records))
        frame = shot(Bench(toy, R7).camera, EXPOSURE)
        assert isinstance(frame, CameraFile)
        assert frame.metadata.exposure == EXPOSURE


def _refuses(code: int) -> Callable[[Request], Reply]:
    return lambda request: Reply(code)


@pytest.mark.parametrize("lists", [(0x9107,), (0x9172,), (0x101B,), (0x9107, 0x9172), (0x9172, 0x101B)])
@pytest.mark.parametrize("code", [ResponseCode.INVALID_PARAMETER, ResponseCode.INVALID_OBJECT_HANDLE])
def test_pieces_come_by_whatever_operation_the_body_does_not_refuse(
    lists: tuple[int, ...], code: int, toy: SimulatedRig
) -> None:
    """Let the last alone of those that it lists work."""
    bench = Bench(toy, R7)
    handlers = bench.devices[0].responder._handlers
    for reader in (
        CanonOperation.GET_PARTIAL_OBJECT,
        CanonOperation.GET_PARTIAL_OBJECT_64,
        Operation(0x101B),
    ):
        if reader not in lists:
            del handlers[reader]
        elif reader != lists[-1]:
            handlers[reader] = replace(handlers[reader], act=_refuses(code))
    assert same(shot(bench.camera, EXPOSURE), bench.truth(EXPOSURE))


def test_a_body_that_refuses_them_all_is_told(toy: SimulatedRig) -> None:
    bench = Bench(toy, R7)
    handlers = bench.devices[0].responder._handlers
    for reader in READERS:
        handlers[reader] = replace(handlers[reader], act=_refuses(ResponseCode.INVALID_PARAMETER))
    with pytest.raises(CameraRefused, match="refused operation 0x101B"):
        shot(bench.camera, EXPOSURE)

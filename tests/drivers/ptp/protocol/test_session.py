"""Sessions: opening, refusals, busy cameras, what is repeated and what is not, objects in pieces."""

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.errors import CameraBusy, CameraLost, CameraProtocol, CameraRefused, CameraTimeout
from drivers.ptp.protocol.codec import Command, Data, Response
from drivers.ptp.protocol.codes import DataType, Operation, PropertyCode, ResponseCode
from drivers.ptp.protocol.datasets import DeviceInfo, DevicePropDesc, ObjectInfo
from drivers.ptp.protocol.refusals import RefusedWith
from drivers.ptp.protocol.session import PATIENCE, PIECE, Download, PtpSession
from drivers.ptp.protocol.transport import UsbTransport

IN = 0x81
INFO = DeviceInfo(model="Scripted", serial="A1", operations=(Operation.GET_PARTIAL_OBJECT,))


@pytest.fixture
def session(scripted: Any, clock: Any) -> PtpSession:
    scripted.scripts[Operation.GET_DEVICE_INFO] = scripted.sends(INFO.pack())
    return PtpSession(UsbTransport(scripted.pipe(), clock), clock)


def halts(scripted: Any) -> Any:
    def script(command: Command, data: bytes) -> list[bytes]:
        scripted.device.port.halt(IN)
        return []

    return script


def count(scripted: Any, operation: int) -> int:
    return sum(command.code == operation for command in scripted.commands)


def test_a_session_opens_with_transaction_0_and_goes_on_with_1(scripted: Any, session: PtpSession) -> None:
    assert session.open() == INFO
    assert scripted.commands == [
        Command(Operation.OPEN_SESSION, 0, (1,)),
        Command(Operation.GET_DEVICE_INFO, 1),
    ]
    session._transaction = 0xFFFFFFFE
    session.run(Operation.SELF_TEST)
    session.run(Operation.SELF_TEST)
    assert [command.transaction for command in scripted.commands[2:]] == [1, 2]
    session.close()
    assert scripted.commands[-1].code == Operation.CLOSE_SESSION
    assert scripted.bus.open_handles == 0


def test_a_session_left_open_is_closed_or_reset(scripted: Any, session: PtpSession) -> None:
    already = scripted.says(ResponseCode.SESSION_ALREADY_OPENED)
    scripted.scripts[Operation.OPEN_SESSION] = scripted.each(already, scripted.ok)
    assert session.open() == INFO
    assert count(scripted, Operation.CLOSE_SESSION) == 1
    scripted.scripts[Operation.OPEN_SESSION] = scripted.each(already, already, scripted.ok)
    assert session.open() == INFO
    assert scripted.resets == 1
    scripted.scripts[Operation.OPEN_SESSION] = already
    with pytest.raises(RefusedWith, match="session already opened"):
        session.open()
    assert scripted.bus.open_handles == 0


def test_a_busy_camera_is_asked_again_for_a_while(scripted: Any, session: PtpSession, clock: Any) -> None:
    session.open()
    busy = scripted.says(ResponseCode.DEVICE_BUSY)
    scripted.scripts[Operation.INITIATE_CAPTURE] = scripted.each(busy, busy, busy, scripted.ok)
    session.run(Operation.INITIATE_CAPTURE, 0, 0)
    assert count(scripted, Operation.INITIATE_CAPTURE) == 4
    assert clock.now() < 0.1
    scripted.scripts[Operation.INITIATE_CAPTURE] = busy
    before = clock.now()
    with pytest.raises(CameraBusy):
        session.run(Operation.INITIATE_CAPTURE, 0, 0)
    assert PATIENCE <= clock.now() - before < PATIENCE + 0.2


def test_refusals_say_what_and_why(scripted: Any, session: PtpSession) -> None:
    session.open()
    scripted.scripts[Operation.INITIATE_CAPTURE] = scripted.says(ResponseCode.STORE_FULL)
    with pytest.raises(CameraRefused, match=r"0x100E \(store full\): free its card"):
        session.run(Operation.INITIATE_CAPTURE, 0, 0)
    scripted.scripts[Operation.INITIATE_CAPTURE] = scripted.says(0xA001)
    with pytest.raises(RefusedWith, match="code 0xA001") as refusal:
        session.run(Operation.INITIATE_CAPTURE, 0, 0)
    assert refusal.value.code == 0xA001


def test_only_what_may_be_done_twice_is_repeated(scripted: Any, session: PtpSession) -> None:
    session.open()
    info = ObjectInfo(filename="IMG_0001.DNG", size=7)
    sends = scripted.sends(info.pack())
    scripted.scripts[Operation.GET_OBJECT_INFO] = scripted.each(halts(scripted), sends)
    assert session.object_info(1) == info
    assert count(scripted, Operation.GET_OBJECT_INFO) == 2
    scripted.scripts[Operation.INITIATE_CAPTURE] = halts(scripted)
    with pytest.raises(CameraProtocol, match="halted"):
        session.run(Operation.INITIATE_CAPTURE, 0, 0)
    assert count(scripted, Operation.INITIATE_CAPTURE) == 1
    scripted.scripts[Operation.GET_OBJECT_INFO] = lambda command, data: []
    with pytest.raises(CameraTimeout):
        session.object_info(1)
    assert count(scripted, Operation.GET_OBJECT_INFO) == 4


def test_a_lost_session_is_opened_again(scripted: Any, session: PtpSession) -> None:
    session.open()
    handles = scripted.sends(b"\x01\0\0\0\x05\0\0\0")
    gone = scripted.says(ResponseCode.SESSION_NOT_OPEN)
    scripted.scripts[Operation.GET_OBJECT_HANDLES] = scripted.each(gone, handles)
    assert session.handles() == (5,)
    assert count(scripted, Operation.OPEN_SESSION) == 2
    assert scripted.commands[-1].transaction == 1
    # After a reset on the wire too: the status stays busy until the reset.
    scripted.device.status = (ResponseCode.DEVICE_BUSY, ())
    scripted.on_reset = lambda: setattr(scripted.device, "status", (ResponseCode.OK, ()))
    scripted.scripts[Operation.GET_OBJECT_HANDLES] = scripted.each(halts(scripted), handles)
    assert session.handles() == (5,)
    assert (count(scripted, Operation.OPEN_SESSION), scripted.resets) == (3, 1)


def test_a_mode_that_ended_with_its_session_takes_a_new_connection(
    scripted: Any, session: PtpSession
) -> None:
    session.open()
    session.has_mode = True
    gone = scripted.says(ResponseCode.SESSION_NOT_OPEN)
    scripted.scripts[Operation.GET_OBJECT_HANDLES] = scripted.each(gone, scripted.sends(bytes(4)))
    for _ in range(2):
        with pytest.raises(CameraLost, match="left remote control"):
            session.handles()
    assert count(scripted, Operation.GET_OBJECT_HANDLES) == 1


def test_a_storage_without_a_card_has_no_objects(scripted: Any, session: PtpSession) -> None:
    session.open()
    invalid, vacant = map(scripted.says, (ResponseCode.INVALID_STORAGE_ID, ResponseCode.STORE_NOT_AVAILABLE))
    one = scripted.sends(b"\x01\0\0\0\x05\0\0\0")
    scripted.scripts[Operation.GET_STORAGE_IDS] = scripted.sends(b"\x02\0\0\0\1\0\0\0\1\0\2\0")
    scripted.scripts[Operation.GET_OBJECT_HANDLES] = scripted.each(invalid, vacant, one, vacant)
    assert session.handles() == (5,)
    assert session.handles() == ()


def test_properties_have_the_type_that_the_camera_says(scripted: Any, session: PtpSession) -> None:
    session.open()
    description = DevicePropDesc(PropertyCode.F_NUMBER, DataType.UINT16, True, 400, 560)
    scripted.scripts[Operation.GET_DEVICE_PROP_DESC] = scripted.sends(description.pack())
    session.write_property(PropertyCode.F_NUMBER, 1100)
    assert scripted.data == [b"\x4c\x04"]
    assert count(scripted, Operation.GET_DEVICE_PROP_DESC) == 1
    with pytest.raises(CameraRefused, match="no value"):
        session.write_property(PropertyCode.F_NUMBER, 70000)
    with pytest.raises(CameraProtocol, match="described property 0x5007, not 0x500D"):
        session.describe(PropertyCode.EXPOSURE_TIME)


def partial(picture: bytes) -> Any:
    def script(command: Command, data: bytes) -> list[bytes]:
        _, offset, most = command.parameters
        piece = picture[offset : offset + most]
        return [
            Data(command.code, command.transaction, piece).pack(),
            Response(ResponseCode.OK, command.transaction, (len(piece),)).pack(),
        ]

    return script


def test_a_download_goes_on_where_it_broke_off(scripted: Any, session: PtpSession) -> None:
    session.open()
    picture = bytes(range(256)) * 10000
    one = Download(5, ObjectInfo(size=len(picture), filename="IMG.DNG"), bytearray())
    sends, silent = partial(picture), lambda command, data: []
    script = scripted.each(sends, halts(scripted), sends, silent, silent, sends)
    scripted.scripts[Operation.GET_PARTIAL_OBJECT] = script
    with pytest.raises(CameraTimeout):
        session.download(one)
    assert bytes(one.data) == picture[: 2 * PIECE]
    assert session.download(one) == picture
    asked = [one.parameters for one in scripted.commands if one.code == Operation.GET_PARTIAL_OBJECT]
    assert [offset // PIECE for _, offset, _ in asked] == [0, 1, 1, 2, 2, 2]


def test_a_camera_without_partial_download_sends_all_at_once(scripted: Any, session: PtpSession) -> None:
    session.open()
    session.info = DeviceInfo()
    scripted.scripts[Operation.GET_OBJECT] = scripted.sends(b"picture")
    assert session.download(Download(5, ObjectInfo(size=7), bytearray())) == b"picture"
    assert session.download(Download(5, ObjectInfo(size=0xFFFFFFFF), bytearray())) == b"picture"
    with pytest.raises(CameraProtocol, match="7 of 8 bytes"):
        session.download(Download(5, ObjectInfo(size=8), bytearray()))
    session.info = INFO
    scripted.scripts[Operation.GET_PARTIAL_OBJECT] = scripted.sends(b"")
    with pytest.raises(CameraProtocol, match="0 bytes where 8"):
        session.download(Download(5, ObjectInfo(size=8), bytearray()))


@settings(max_examples=30)
@given(size=st.integers(0, 3 * PIECE), failures=st.lists(st.booleans(), max_size=4))
def test_downloads_of_every_size_are_whole(size: int, failures: list[bool]) -> None:
    """The pieces of a fetch that fails at will, taken up again each time."""
    picture = (b"0123456789abcdef" * (size // 16 + 1))[:size]
    one = Download(1, ObjectInfo(size=size), bytearray())
    session = PtpSession.__new__(PtpSession)
    session.where = "here"

    def fetch(offset: int, most: int) -> bytes:
        if failures and failures.pop():
            raise CameraTimeout("no answer")
        return picture[offset : offset + most]

    while True:
        try:
            session.pieces(one, fetch)
            break
        except CameraTimeout:
            pass
    assert bytes(one.data) == picture

"""The bytes of PTP: round trips, known bytes, and nothing but CameraProtocol for damaged ones."""

import contextlib
from collections.abc import Callable
from datetime import UTC, datetime, timedelta, timezone

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import CameraProtocol
from drivers.ptp.protocol import codec
from drivers.ptp.protocol.codec import (
    Command,
    Container,
    ContainerType,
    Data,
    Event,
    Header,
    Reader,
    Response,
)
from drivers.ptp.protocol.codes import UNKNOWN_LENGTH, DataType, Operation
from drivers.ptp.protocol.datasets import (
    DeviceInfo,
    DevicePropDesc,
    EnumForm,
    ObjectInfo,
    RangeForm,
    StorageInfo,
)

u16, u32, u64 = (st.integers(0, 2**bits - 1) for bits in (16, 32, 64))
texts = st.text(st.characters(codec="utf-16-le", exclude_characters="\0"), max_size=127)
codes = st.lists(u16, max_size=20).map(tuple)


def parameters(most: int) -> st.SearchStrategy[tuple[int, ...]]:
    return st.lists(u32, max_size=most).map(tuple)


containers = st.one_of(
    st.builds(Command, u16, u32, parameters(5)),
    st.builds(Response, u16, u32, parameters(5)),
    st.builds(Event, u16, u32, parameters(3)),
    st.builds(Data, u16, u32, st.binary(max_size=300)),
)


def values(kind: DataType) -> st.SearchStrategy[codec.Value]:
    if kind == DataType.STRING:
        return texts
    bits = 8 * kind.item_size
    low = -(2 ** (bits - 1)) if kind.is_signed else 0
    one = st.integers(low, low + 2**bits - 1)
    return st.lists(one, max_size=5).map(tuple) if kind.is_array else one


@st.composite
def descriptions(draw: st.DrawFn) -> DevicePropDesc:
    kind = draw(st.sampled_from(DataType))
    one = values(kind)
    form = draw(
        st.one_of(
            st.none(),
            st.builds(RangeForm, one, one, one),
            st.lists(one, max_size=9).map(lambda listed: EnumForm(tuple(listed))),
        )
    )
    return DevicePropDesc(draw(u16), kind, draw(st.booleans()), draw(one), draw(one), form)


device_infos = st.builds(
    DeviceInfo, u16, u32, u16, texts, u16, codes, codes, codes, codes, codes, texts, texts, texts, texts
)
storage_infos = st.builds(StorageInfo, u16, u16, u16, u64, u64, u32, texts, texts)
object_infos = st.builds(
    ObjectInfo, u32, u16, u16, u32, u16, *[u32] * 7, u16, u32, u32, texts, texts, texts, texts
)
datasets = st.one_of(device_infos, storage_infos, object_infos, descriptions())
UNPACKERS: tuple[Callable[[bytes], object], ...] = (
    Header.unpack,
    codec.parse,
    Command.unpack,
    Response.unpack,
    Event.unpack,
    Data.unpack,
    DeviceInfo.unpack,
    StorageInfo.unpack,
    ObjectInfo.unpack,
    DevicePropDesc.unpack,
    *(lambda data, kind=kind: codec.unpack_value(kind, data) for kind in DataType),
)


@given(containers)
def test_containers_come_back(container: Container) -> None:
    packed = container.pack()
    assert codec.parse(packed) == container
    assert Header.unpack(packed).length == len(packed)


@given(datasets)
def test_datasets_come_back(dataset: DeviceInfo | StorageInfo | ObjectInfo | DevicePropDesc) -> None:
    assert type(dataset).unpack(dataset.pack()) == dataset
    assert type(dataset).unpack(dataset.pack() + b"more") == dataset


@given(datasets, st.data())
def test_a_cut_dataset_is_damaged(
    dataset: DeviceInfo | StorageInfo | ObjectInfo | DevicePropDesc, data: st.DataObject
) -> None:
    packed = dataset.pack()
    with pytest.raises(CameraProtocol):
        type(dataset).unpack(packed[: data.draw(st.integers(0, len(packed) - 1))])


@given(containers, st.data())
def test_a_cut_container_is_damaged(container: Container, data: st.DataObject) -> None:
    packed = container.pack()
    with pytest.raises(CameraProtocol):
        codec.parse(packed[: data.draw(st.integers(0, len(packed) - 1))])


@given(st.binary(max_size=400), st.sampled_from(UNPACKERS))
def test_any_bytes_give_a_value_or_our_error(data: bytes, unpack: Callable[[bytes], object]) -> None:
    with contextlib.suppress(CameraProtocol):
        unpack(data)


@given(st.sampled_from(DataType), st.data())
def test_values_come_back(kind: DataType, data: st.DataObject) -> None:
    value = data.draw(values(kind))
    assert codec.unpack_value(kind, codec.pack_value(kind, value)) == value


@given(st.datetimes(), st.one_of(st.none(), st.integers(-14 * 60, 14 * 60)))
def test_moments_come_back_to_a_tenth_of_a_second(moment: datetime, minutes: int | None) -> None:
    zone = None if minutes is None else timezone(timedelta(minutes=minutes))
    moment = moment.replace(microsecond=moment.microsecond // 100000 * 100000, tzinfo=zone)
    again = datetime.fromisoformat(codec.pack_moment(moment))
    assert again == moment
    assert again.utcoffset() == moment.utcoffset()


def test_bytes_are_those_of_the_standard() -> None:
    command = Command(Operation.OPEN_SESSION, 0, (1,)).pack()
    assert command == bytes.fromhex("10000000 0100 0210 00000000 01000000")
    assert codec.pack_string("A") == bytes.fromhex("02 4100 0000")
    assert codec.pack_string("") == b"\0"
    assert codec.pack_array(DataType.UINT16, (0x3801,)) == bytes.fromhex("01000000 0138")
    description = DevicePropDesc(0x5007, DataType.UINT16, True, 400, 560, EnumForm((400, 560)))
    assert description.pack() == bytes.fromhex("0750 0400 01 9001 3002 02 0200 9001 3002")
    assert codec.pack_moment(datetime(2026, 1, 2, 3, 4, 5, 500000, UTC)) == "20260102T030405.5Z"
    zone = timezone(timedelta(hours=2, minutes=30))
    assert codec.pack_moment(datetime(2026, 1, 2, 3, 4, 5, tzinfo=zone)) == "20260102T030405+0230"


def test_lengths_are_believed_only_where_unknown_is_allowed() -> None:
    unknown = Header(UNKNOWN_LENGTH, ContainerType.DATA, 0x1009, 7).pack() + b"pixels"
    assert Data.unpack(unknown) == Data(0x1009, 7, b"pixels")
    for broken in (
        Header(UNKNOWN_LENGTH, ContainerType.RESPONSE, 0x2001, 7).pack(),
        Header(14, ContainerType.RESPONSE, 0x2001, 7).pack() + b"ab",
        Header(36, ContainerType.RESPONSE, 0x2001, 7).pack() + bytes(24),
        Header(28, ContainerType.EVENT, 0x4002, 7).pack() + bytes(16),
        b"\x0c\0\0\0\x05\0" + bytes(6),
        b"\x0b\0\0\0\x03\0" + bytes(6),
    ):
        with pytest.raises(CameraProtocol):
            codec.parse(broken)


def test_an_array_that_claims_too_much_allocates_nothing() -> None:
    with pytest.raises(CameraProtocol, match="4294967295 items in 4 bytes"):
        Reader(b"\xff\xff\xff\xff1234").array(DataType.UINT64)


@pytest.mark.parametrize(
    ("kind", "value"),
    [
        (DataType.UINT16, 65536),
        (DataType.INT8, -129),
        (DataType.UINT32, -1),
        (DataType.UINT32, "7"),
        (DataType.STRING, 7),
        (DataType.STRING, "a\0b"),
        (DataType.STRING, "\ud800"),
        (DataType.STRING, "x" * 255),
        (DataType.ARRAY_UINT8, 7),
        (DataType.ARRAY_UINT8, (256,)),
    ],
)
def test_what_does_not_fit_is_the_callers_mistake(kind: DataType, value: codec.Value) -> None:
    with pytest.raises(ValueError, match=r"fit|not a|surrogate"):
        codec.pack_value(kind, value)


def test_too_many_parameters_are_the_callers_mistake() -> None:
    with pytest.raises(ValueError, match="more than 3"):
        Event(0x4002, 0, (1, 2, 3, 4)).pack()
    with pytest.raises(ValueError, match="header"):
        Command(0x1_0000).pack()

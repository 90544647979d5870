"""The bytes of PTP on USB: containers, integers, arrays, strings and dates, all little-endian.

Nothing here knows of a camera. Bytes that are cut off or make no sense give CameraProtocol and no other
error; a value that does not fit its field when packing is the caller's mistake and gives ValueError.
"""

import struct
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import datetime
from enum import IntEnum
from typing import ClassVar, Self

from drivers.errors import CameraProtocol
from drivers.ptp.protocol.codes import UNKNOWN_LENGTH, DataType

HEADER_SIZE = 12

Value = int | str | tuple[int, ...]
"""A property's value: an integer, a string or an array of integers."""


class ContainerType(IntEnum):
    """Container type."""

    COMMAND = 1
    DATA = 2
    RESPONSE = 3
    EVENT = 4


def damaged(what: str) -> CameraProtocol:
    """The error for bytes that make no sense."""
    return CameraProtocol(f"The camera sent {what}: try again, or switch the camera off and on.")


@dataclass(frozen=True)
class Header:
    """The first 12 bytes of a container; `length` counts them too."""

    length: int
    kind: ContainerType
    code: int
    transaction: int

    def pack(self) -> bytes:
        """12 bytes."""
        try:
            return struct.pack("<IHHI", self.length, self.kind, self.code, self.transaction)
        except struct.error as error:
            raise ValueError(f"{self} does not fit a header") from error

    @classmethod
    def unpack(cls, data: bytes) -> Self:
        """Parse the beginning of `data`; CameraProtocol if it is too short or of unknown type."""
        if len(data) < HEADER_SIZE:
            raise damaged(f"a container of {len(data)} bytes, shorter than its header")
        length, kind, code, transaction = struct.unpack_from("<IHHI", data)
        if kind not in ContainerType.__members__.values():
            raise damaged(f"a container of the unknown type {kind}")
        if length < HEADER_SIZE:
            raise damaged(f"a container that claims a length of {length} bytes")
        return cls(length, ContainerType(kind), code, transaction)


def _unpack(data: bytes, kind: ContainerType) -> tuple[Header, bytes]:
    """The header and payload of a whole container."""
    header = Header.unpack(data)
    if header.kind != kind:
        raise damaged(f"a {header.kind.name.lower()} where a {kind.name.lower()} was due")
    unknown = header.length == UNKNOWN_LENGTH and kind == ContainerType.DATA
    if header.length != len(data) and not unknown:
        raise damaged(f"{len(data)} bytes as a container of {header.length}")
    return header, data[HEADER_SIZE:]


@dataclass(frozen=True)
class _WithParameters:
    """A container whose payload is a few 32-bit parameters."""

    KIND: ClassVar[ContainerType]
    MOST: ClassVar[int] = 5

    code: int
    transaction: int = 0
    parameters: tuple[int, ...] = ()

    def pack(self) -> bytes:
        """The whole container."""
        if len(self.parameters) > self.MOST:
            raise ValueError(f"{len(self.parameters)} parameters are more than {self.MOST}")
        payload = b"".join(pack_value(DataType.UINT32, value) for value in self.parameters)
        return Header(HEADER_SIZE + len(payload), self.KIND, self.code, self.transaction).pack() + payload

    @classmethod
    def unpack(cls, data: bytes) -> Self:
        """Parse exactly one container."""
        header, payload = _unpack(data, cls.KIND)
        if len(payload) % 4 or len(payload) > 4 * cls.MOST:
            raise damaged(f"a {cls.KIND.name.lower()} with {len(payload)} bytes of parameters")
        return cls(header.code, header.transaction, struct.unpack(f"<{len(payload) // 4}I", payload))


@dataclass(frozen=True)
class Command(_WithParameters):
    """Host to camera: an operation and at most 5 parameters."""

    KIND = ContainerType.COMMAND


@dataclass(frozen=True)
class Response(_WithParameters):
    """Camera to host, the end of a transaction: a response code and at most 5 parameters."""

    KIND = ContainerType.RESPONSE


@dataclass(frozen=True)
class Event(_WithParameters):
    """Camera to host on the interrupt endpoint: an event code and at most 3 parameters."""

    KIND = ContainerType.EVENT
    MOST = 3


@dataclass(frozen=True)
class Data:
    """The data phase of a transaction, in one direction or the other."""

    code: int
    transaction: int = 0
    payload: bytes = b""

    def pack(self) -> bytes:
        """The whole container; one that is too long for the length says UNKNOWN_LENGTH."""
        length = min(HEADER_SIZE + len(self.payload), UNKNOWN_LENGTH)
        return Header(length, ContainerType.DATA, self.code, self.transaction).pack() + self.payload

    @classmethod
    def unpack(cls, data: bytes) -> Self:
        """Parse exactly one container."""
        header, payload = _unpack(data, ContainerType.DATA)
        return cls(header.code, header.transaction, payload)


Container = Command | Data | Response | Event


def parse(data: bytes) -> Container:
    """A whole container of whichever type its header says."""
    kinds: dict[ContainerType, type[Container]] = {
        ContainerType.COMMAND: Command,
        ContainerType.DATA: Data,
        ContainerType.RESPONSE: Response,
        ContainerType.EVENT: Event,
    }
    return kinds[Header.unpack(data).kind].unpack(data)


def pack_string(text: str) -> bytes:
    """A count of UTF-16 units with the closing NUL, and they; ValueError beyond 254 or with a NUL inside."""
    if not text:
        return b"\0"
    try:
        units = text.encode("utf-16-le")
    except UnicodeEncodeError as error:
        raise ValueError(f"{text!r} holds half a surrogate pair") from error
    if len(units) > 2 * 254 or "\0" in text:
        raise ValueError(f"{text!r} does not fit a PTP string")
    return bytes((len(units) // 2 + 1,)) + units + b"\0\0"


def pack_value(data_type: DataType, value: Value) -> bytes:
    """A value of a type; ValueError if it is not of that type or does not fit."""
    if data_type == DataType.STRING:
        if not isinstance(value, str):
            raise ValueError(f"{value!r} is not a string")
        return pack_string(value)
    if data_type.is_array:
        if not isinstance(value, tuple):
            raise ValueError(f"{value!r} is not an array")
        return len(value).to_bytes(4, "little") + b"".join(_pack_integer(data_type, item) for item in value)
    if not isinstance(value, int):
        raise ValueError(f"{value!r} is not an integer")
    return _pack_integer(data_type, value)


def _pack_integer(data_type: DataType, value: int) -> bytes:
    try:
        return int(value).to_bytes(data_type.item_size, "little", signed=data_type.is_signed)
    except OverflowError as error:
        raise ValueError(f"{value} does not fit {data_type.name}") from error


def unpack_value(data_type: DataType, data: bytes) -> Value:
    """A value of a type from the beginning of `data`."""
    return Reader(data).value(data_type)


def pack_array(item: DataType, values: Iterable[int]) -> bytes:
    """A count and that many integers of type `item`."""
    return pack_value(DataType(0x4000 | item), tuple(values))


class Reader:
    """Takes values one after the other from bytes; CameraProtocol once they do not suffice."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, 0

    @property
    def remaining(self) -> int:
        """Bytes not taken yet."""
        return len(self._data) - self._at

    def take(self, size: int) -> bytes:
        """The next `size` bytes."""
        if size > self.remaining:
            raise damaged(f"{self.remaining} bytes where {size} more were due")
        self._at += size
        return self._data[self._at - size : self._at]

    def peek_u16(self) -> int:
        """The next 16 bits, without taking them."""
        return int.from_bytes(self._data[self._at : self._at + 2], "little")

    def integer(self, data_type: DataType) -> int:
        """The next integer of a type."""
        return int.from_bytes(self.take(data_type.item_size), "little", signed=data_type.is_signed)

    def u8(self) -> int:
        """The next byte."""
        return self.integer(DataType.UINT8)

    def u16(self) -> int:
        """The next 16 bits."""
        return self.integer(DataType.UINT16)

    def u32(self) -> int:
        """The next 32 bits."""
        return self.integer(DataType.UINT32)

    def u64(self) -> int:
        """The next 64 bits."""
        return self.integer(DataType.UINT64)

    def array(self, item: DataType) -> tuple[int, ...]:
        """A count and that many integers of type `item`."""
        count = self.u32()
        if count * item.item_size > self.remaining:
            raise damaged(f"an array of {count} items in {self.remaining} bytes")
        return tuple(self.integer(item) for _ in range(count))

    def string(self) -> str:
        """Up to its first NUL; what is no UTF-16 becomes U+FFFD, as cameras leave rubbish in descriptions."""
        return self.take(2 * self.u8()).decode("utf-16-le", "replace").partition("\0")[0]

    def value(self, data_type: DataType) -> Value:
        """The next value of any type."""
        if data_type == DataType.STRING:
            return self.string()
        if data_type.is_array:
            return self.array(DataType(data_type & 0xF))
        return self.integer(data_type)


def pack_moment(moment: datetime) -> str:
    """`YYYYMMDDThhmmss[.s][Z|±hhmm]`, with tenths of a second if there are any and a zone if it has one."""
    tenths = f".{moment.microsecond // 100000}" if moment.microsecond >= 100000 else ""
    date = f"{moment.year:04d}" + moment.strftime("%m%dT%H%M%S")
    offset = moment.utcoffset()
    return date + tenths + ("" if offset is None else moment.strftime("%z")[:5] if offset else "Z")

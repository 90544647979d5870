"""The datasets that cameras answer with: DeviceInfo, StorageInfo, ObjectInfo, DevicePropDesc.

`pack` and `unpack` as in `codec`: damaged bytes give CameraProtocol, values that do not fit ValueError.
Bytes after a dataset are left alone, since some bodies append their own.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import Self

from drivers.ptp.protocol.codec import Reader, Value, damaged, pack_array, pack_string, pack_value
from drivers.ptp.protocol.codes import UNKNOWN_LENGTH, DataType

_U8, _U16, _U32, _U64 = DataType.UINT8, DataType.UINT16, DataType.UINT32, DataType.UINT64


@dataclass(frozen=True)
class DeviceInfo:
    """Identity and abilities of a camera; the numbers of operations, events and so on are as sent."""

    standard_version: int = 100
    vendor_extension: int = 0
    vendor_version: int = 0
    vendor_description: str = ""
    functional_mode: int = 0
    operations: tuple[int, ...] = ()
    events: tuple[int, ...] = ()
    properties: tuple[int, ...] = ()
    capture_formats: tuple[int, ...] = ()
    image_formats: tuple[int, ...] = ()
    manufacturer: str = ""
    model: str = ""
    device_version: str = ""
    serial: str = ""

    def pack(self) -> bytes:
        """Pack as the answer to GetDeviceInfo."""
        lists = (self.operations, self.events, self.properties, self.capture_formats, self.image_formats)
        names = (self.manufacturer, self.model, self.device_version, self.serial)
        return b"".join(
            (
                pack_value(_U16, self.standard_version),
                pack_value(_U32, self.vendor_extension),
                pack_value(_U16, self.vendor_version),
                pack_string(self.vendor_description),
                pack_value(_U16, self.functional_mode),
                *(pack_array(_U16, codes) for codes in lists),
                *(pack_string(name) for name in names),
            )
        )

    @classmethod
    def unpack(cls, data: bytes) -> Self:
        """Unpack the answer to GetDeviceInfo."""
        reader = Reader(data)
        return cls(
            reader.u16(),
            reader.u32(),
            reader.u16(),
            reader.string(),
            reader.u16(),
            reader.array(_U16),
            reader.array(_U16),
            reader.array(_U16),
            reader.array(_U16),
            reader.array(_U16),
            reader.string(),
            reader.string(),
            reader.string(),
            reader.string(),
        )


@dataclass(frozen=True)
class StorageInfo:
    """A card or the camera's memory; capacities in bytes."""

    storage_type: int = 0
    filesystem_type: int = 0
    access: int = 0
    capacity: int = 0
    free_bytes: int = 0
    free_images: int = 0
    description: str = ""
    label: str = ""

    def pack(self) -> bytes:
        """Pack as the answer to GetStorageInfo."""
        return b"".join(
            (
                pack_value(_U16, self.storage_type),
                pack_value(_U16, self.filesystem_type),
                pack_value(_U16, self.access),
                pack_value(_U64, self.capacity),
                pack_value(_U64, self.free_bytes),
                pack_value(_U32, self.free_images),
                pack_string(self.description),
                pack_string(self.label),
            )
        )

    @classmethod
    def unpack(cls, data: bytes) -> Self:
        """Unpack the answer to GetStorageInfo."""
        reader = Reader(data)
        return cls(
            reader.u16(),
            reader.u16(),
            reader.u16(),
            reader.u64(),
            reader.u64(),
            reader.u32(),
            reader.string(),
            reader.string(),
        )


@dataclass(frozen=True)
class ObjectInfo:
    """A file or folder in the camera; dates as `codec.pack_moment` writes them."""

    storage: int = 0
    format: int = 0
    protection: int = 0
    size: int = 0
    """Bytes; UNKNOWN_LENGTH for 4 GiB and more."""
    thumb_format: int = 0
    thumb_size: int = 0
    thumb_width: int = 0
    thumb_height: int = 0
    width: int = 0
    height: int = 0
    bit_depth: int = 0
    parent: int = 0
    association_type: int = 0
    association_description: int = 0
    sequence: int = 0
    filename: str = ""
    capture_date: str = ""
    modification_date: str = ""
    keywords: str = ""

    def pack(self) -> bytes:
        """Pack as the answer to GetObjectInfo."""
        sizes = (self.thumb_size, self.thumb_width, self.thumb_height, self.width, self.height)
        return b"".join(
            (
                pack_value(_U32, self.storage),
                pack_value(_U16, self.format),
                pack_value(_U16, self.protection),
                pack_value(_U32, min(self.size, UNKNOWN_LENGTH)),
                pack_value(_U16, self.thumb_format),
                *(pack_value(_U32, size) for size in (*sizes, self.bit_depth, self.parent)),
                pack_value(_U16, self.association_type),
                pack_value(_U32, self.association_description),
                pack_value(_U32, self.sequence),
                pack_string(self.filename),
                pack_string(self.capture_date),
                pack_string(self.modification_date),
                pack_string(self.keywords),
            )
        )

    @classmethod
    def unpack(cls, data: bytes) -> Self:
        """Unpack the answer to GetObjectInfo."""
        reader = Reader(data)
        return cls(
            reader.u32(),
            reader.u16(),
            reader.u16(),
            reader.u32(),
            reader.u16(),
            reader.u32(),
            reader.u32(),
            reader.u32(),
            reader.u32(),
            reader.u32(),
            reader.u32(),
            reader.u32(),
            reader.u16(),
            reader.u32(),
            reader.u32(),
            reader.string(),
            reader.string(),
            reader.string(),
            reader.string() if reader.remaining else "",  # some leave the last one out
        )


class _Form(IntEnum):
    NONE = 0
    RANGE = 1
    ENUMERATION = 2


@dataclass(frozen=True)
class RangeForm:
    """Values from minimum to maximum in steps."""

    minimum: Value
    maximum: Value
    step: Value


@dataclass(frozen=True)
class EnumForm:
    """These values and no others."""

    values: tuple[Value, ...]


@dataclass(frozen=True)
class DevicePropDesc:
    """A property of the camera: its type, whether it can be set, its value and the values it may have."""

    code: int
    data_type: DataType
    writable: bool
    default: Value
    current: Value
    form: RangeForm | EnumForm | None = None

    def pack(self) -> bytes:
        """Pack as the answer to GetDevicePropDesc."""
        head = (
            pack_value(_U16, self.code)
            + pack_value(_U16, self.data_type)
            + pack_value(_U8, int(self.writable))
            + pack_value(self.data_type, self.default)
            + pack_value(self.data_type, self.current)
        )
        values: tuple[Value, ...]
        match self.form:
            case RangeForm(minimum, maximum, step):
                kind, values = bytes((_Form.RANGE,)), (minimum, maximum, step)
            case EnumForm(values):
                kind = bytes((_Form.ENUMERATION,)) + pack_value(_U16, len(values))
            case None:
                kind, values = bytes((_Form.NONE,)), ()
        return head + kind + b"".join(pack_value(self.data_type, value) for value in values)

    @classmethod
    def unpack(cls, data: bytes) -> Self:
        """Unpack the answer to GetDevicePropDesc."""
        reader = Reader(data)
        code, number = reader.u16(), reader.u16()
        if number not in DataType.__members__.values():
            raise damaged(f"a property of the unknown data type 0x{number:04X}")
        kind = DataType(number)
        writable, default, current = bool(reader.u8()), reader.value(kind), reader.value(kind)
        return cls(code, kind, writable, default, current, _form(reader, kind))


def _form(reader: Reader, kind: DataType) -> RangeForm | EnumForm | None:
    number = reader.u8()
    if number == _Form.NONE:
        return None
    if number == _Form.RANGE:
        return RangeForm(reader.value(kind), reader.value(kind), reader.value(kind))
    if number == _Form.ENUMERATION:
        return EnumForm(tuple(reader.value(kind) for _ in range(reader.u16())))
    raise damaged(f"a property of the unknown form {number}")

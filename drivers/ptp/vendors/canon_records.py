"""Records of a Canon's GetEvent, and those in which it announces a file.

Source: libgphoto2's layout (its ptp-pack.c), and what bodies sent to its users. Since about 2016 bodies have
records with sizes of 64 bits; an R5 Mark II has some in which the name is in another place, or is left out.
Verified against: the simulated cameras, which follow the same notes; no hardware.
"""

from collections.abc import Iterator
from typing import NamedTuple

from drivers.ptp.protocol.codec import Reader, damaged
from drivers.ptp.protocol.codes import CanonEvent, FormatCode
from drivers.ptp.protocol.datasets import ObjectInfo
from drivers.ptp.protocol.session import Download

_SUFFIXES = {
    FormatCode.EXIF_JPEG: ".JPG",
    FormatCode.VENDOR_RAW_1: ".CRW",
    FormatCode.VENDOR_RAW_2: ".CR2",
    FormatCode.CANON_CR3: ".CR3",
}


class _Layout(NamedTuple):
    """Byte offsets of the fields after the handle; storage and name: None if absent.

    wide: whether the size has 64 bits.
    """

    storage: int | None
    format: int
    size: int
    wide: bool
    name: int | None


_LAYOUTS = {
    CanonEvent.OBJECT_ADDED_EX: _Layout(4, 8, 20, False, 32),
    CanonEvent.OBJECT_ADDED_EX_64: _Layout(4, 8, 20, True, 36),
    CanonEvent.OBJECT_ADDED_EX_64_LONG_NAME: _Layout(4, 8, 20, True, None),
    CanonEvent.REQUEST_OBJECT_TRANSFER: _Layout(None, 4, 12, False, 20),
    CanonEvent.REQUEST_OBJECT_TRANSFER_64: _Layout(None, 4, 12, True, 20),
    CanonEvent.REQUEST_OBJECT_TRANSFER_64_LONG_NAME: _Layout(None, 4, 12, True, None),
}
OBJECTS = frozenset(_LAYOUTS)
"""Record types that announce a file."""


def unpack_records(data: bytes) -> Iterator[tuple[int, bytes]]:
    """The records of GetEvent: type and payload, up to the empty one that ends them; CameraProtocol."""
    reader = Reader(data)
    while reader.remaining >= 8:
        size, kind = reader.u32(), reader.u32()
        if (size, kind) == (8, 0):
            return
        if size < 8:
            raise damaged(f"an event record of {size} bytes")
        yield kind, reader.take(size - 8)


def unpack_object(kind: int, payload: bytes) -> Download:
    """Read a record that announces a file, of a type in OBJECTS; CameraProtocol if it is cut off.

    A file without a name is called by its handle, with the suffix of its format.
    """
    layout = _LAYOUTS[CanonEvent(kind)]

    def number(at: int, size: int) -> int:
        if at + size > len(payload):
            raise damaged(f"an event record of a file with {len(payload)} bytes")
        return int.from_bytes(payload[at : at + size], "little")

    handle, form = number(0, 4), number(layout.format, 2)
    name = "" if layout.name is None else _text(payload[layout.name :])
    info = ObjectInfo(
        storage=0 if layout.storage is None else number(layout.storage, 4),
        format=form,
        size=number(layout.size, 8 if layout.wide else 4),
        filename=name or f"{handle:08X}{_suffix(form)}",
    )
    return Download(handle, info, bytearray())


def _text(field: bytes) -> str:
    return field.partition(b"\0")[0].decode("ascii", "replace")


def _suffix(form: int) -> str:
    return _SUFFIXES[FormatCode(form)] if form in _SUFFIXES else ""

"""The bootstrap registers of a USB3 Vision device and the manifest, where its GenICam XML is found."""

import hashlib
from dataclasses import dataclass
from enum import IntEnum

from drivers.errors import CameraProtocol
from drivers.genicam.archive import LARGEST_XML, unzipped
from drivers.u3v.control import ControlChannel

STRING = 64
"""Bytes of a bootstrap string, NUL and all."""
ENTRY = 64
"""Bytes of a manifest entry."""
_MOST_ENTRIES = 64


class Abrm(IntEnum):
    """Technology-agnostic registers: addresses."""

    VERSION = 0x000
    MANUFACTURER = 0x004
    MODEL = 0x044
    FAMILY = 0x084
    DEVICE_VERSION = 0x0C4
    INFO = 0x104
    SERIAL = 0x144
    USER_NAME = 0x184
    CAPABILITY = 0x1C4
    RESPONSE_TIME = 0x1CC
    MANIFEST = 0x1D0
    SBRM = 0x1D8
    CONFIGURATION = 0x1E0
    TIMESTAMP = 0x1F0
    LATCH = 0x1F8


class Sbrm(IntEnum):
    """USB3 Vision registers: offsets from where ABRM says."""

    VERSION = 0x00
    CAPABILITY = 0x04
    LARGEST_COMMAND = 0x14
    LARGEST_ANSWER = 0x18
    STREAMS = 0x1C
    SIRM = 0x20
    SIRM_LENGTH = 0x28
    EIRM = 0x2C
    SPEED = 0x40


class Sirm(IntEnum):
    """Streaming registers: offsets from where SBRM says."""

    INFO = 0x00
    CONTROL = 0x04
    REQUIRED_PAYLOAD = 0x08
    REQUIRED_LEADER = 0x10
    REQUIRED_TRAILER = 0x14
    LARGEST_LEADER = 0x18
    TRANSFER_SIZE = 0x1C
    TRANSFER_COUNT = 0x20
    LAST_TRANSFER = 0x24
    LAST_TRANSFER_2 = 0x28
    LARGEST_TRAILER = 0x2C


@dataclass(frozen=True)
class Bootstrap:
    """Device description before its XML is read. sirm: address, None where it cannot stream."""

    manufacturer: str
    model: str
    version: str
    serial: str
    manifest: int
    sirm: int | None


def read_bootstrap(control: ControlChannel) -> Bootstrap:
    """Read the registers, and set the channel to the packets and the patience that they name."""
    patience = control.read_number(Abrm.RESPONSE_TIME, 4) / 1000
    sbrm = control.read_number(Abrm.SBRM, 8)
    control.limit(
        control.read_number(sbrm + Sbrm.LARGEST_COMMAND, 4),
        control.read_number(sbrm + Sbrm.LARGEST_ANSWER, 4),
        patience,
    )
    streams = control.read_number(sbrm + Sbrm.STREAMS, 4)
    return Bootstrap(
        manufacturer=_string(control, Abrm.MANUFACTURER),
        model=_string(control, Abrm.MODEL),
        version=_string(control, Abrm.DEVICE_VERSION),
        serial=_string(control, Abrm.SERIAL),
        manifest=control.read_number(Abrm.MANIFEST, 8),
        sirm=control.read_number(sbrm + Sbrm.SIRM, 8) if streams else None,
    )


def _string(control: ControlChannel, address: int) -> str:
    return control.read(address, STRING).split(b"\0")[0].decode("utf-8", "replace")


class AbrmClock:
    """The timestamp registers, ns. Errors are those of the control channel."""

    def __init__(self, control: ControlChannel) -> None:
        self._control = control

    def latch(self) -> None:
        """Keep what the clock shows now."""
        self._control.write_number(Abrm.LATCH, 4, 1)

    def latched(self) -> int:
        """Return what was kept."""
        return self._control.read_number(Abrm.TIMESTAMP, 8)


@dataclass(frozen=True)
class ManifestEntry:
    """Location of an XML. version: major, minor, subminor; sha1: of the bytes there, zeros if not given."""

    version: tuple[int, int, int]
    zipped: bool
    address: int
    size: int
    sha1: bytes

    def pack(self) -> bytes:
        """The 64 bytes of the entry."""
        major, minor, subminor = self.version
        head = subminor.to_bytes(2, "little") + bytes((minor, major))
        schema = (1 << 10 if self.zipped else 0).to_bytes(4, "little")
        place = self.address.to_bytes(8, "little") + self.size.to_bytes(8, "little")
        return (head + schema + place + self.sha1).ljust(ENTRY, b"\0")

    @classmethod
    def parse(cls, data: bytes) -> "ManifestEntry":
        """Parse its 64 bytes. CameraProtocol if the file type is neither raw nor zipped XML."""
        kind = int.from_bytes(data[4:8], "little") >> 10 & 0x3F
        if len(data) != ENTRY or kind > 1:
            raise CameraProtocol(f"a manifest entry of {len(data)} bytes and file type {kind} is unknown")
        return cls(
            (data[3], data[2], int.from_bytes(data[:2], "little")),
            kind == 1,
            int.from_bytes(data[8:16], "little"),
            int.from_bytes(data[16:24], "little"),
            bytes(data[24:44]),
        )


def read_xml(control: ControlChannel, manifest: int) -> bytes:
    """The GenICam XML of the newest manifest entry, unzipped. CameraProtocol if it is damaged."""
    count = control.read_number(manifest, 8)
    if not 1 <= count <= _MOST_ENTRIES:
        raise _damaged(control, f"its manifest has {count} entries")
    try:
        entries = [
            ManifestEntry.parse(control.read(manifest + 8 + ENTRY * index, ENTRY)) for index in range(count)
        ]
    except CameraProtocol as error:
        raise _damaged(control, str(error)) from error
    entry = max(entries, key=lambda manifest: manifest.version)
    if not 0 < entry.size <= LARGEST_XML:
        raise _damaged(control, f"its description has {entry.size} bytes")
    data = control.read(entry.address, entry.size)
    if any(entry.sha1) and hashlib.sha1(data, usedforsecurity=False).digest() != entry.sha1:
        raise _damaged(control, "its description does not match its SHA-1")
    if not entry.zipped:
        return data.rstrip(b"\0")
    try:
        return unzipped(data)
    except CameraProtocol as error:
        raise _damaged(control, str(error)) from error


def _damaged(control: ControlChannel, why: str) -> CameraProtocol:
    return CameraProtocol(f"{control.where}: {why}: update the camera's firmware.")

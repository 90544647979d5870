"""The memory of the simulated machine vision camera: bootstrap registers, manifest, XML, features."""

import hashlib
import struct
from collections.abc import Mapping

from drivers.sim.u3v.description import LINES, READ_ONLY, Feature, zipped
from drivers.u3v.gencp import Status
from drivers.u3v.registers import ENTRY, STRING, Abrm, ManifestEntry, Sbrm, Sirm

LARGEST_PACKET = 1024
"""Bytes of the longest control packet, either way."""
RESPONSE_TIME = 200
"""Milliseconds that an answer may take."""
_SBRM, _SIRM, _MANIFEST, _FEATURES, _XML = 0x1000, 0x2000, 0x3000, 0x10000, 0x100000
_ALIGNMENT = 10
"""Transfers are multiples of 2 to this."""
_WRITABLE_SIRM = (
    Sirm.CONTROL,
    Sirm.LARGEST_LEADER,
    Sirm.TRANSFER_SIZE,
    Sirm.TRANSFER_COUNT,
    Sirm.LAST_TRANSFER,
    Sirm.LAST_TRANSFER_2,
    Sirm.LARGEST_TRAILER,
)


def width(address: int) -> int:
    """Bytes of a register that the host may write."""
    return 8 if address == Feature.EXPOSURE_TIME else 4


class Denied(Exception):
    """A read or a write that ends with a status."""

    def __init__(self, status: Status) -> None:
        super().__init__(status.name)
        self.status = status


class DeviceMemory:
    """Regions of bytes; what is not in one is not there."""

    def __init__(self, names: Mapping[Abrm, str], xml: str) -> None:
        """names: the strings of the bootstrap registers."""
        archive = zipped(xml)
        sha1 = hashlib.sha1(archive, usedforsecurity=False).digest()
        entry = ManifestEntry((1, 0, 0), True, _XML, len(archive), sha1)
        self._regions = {
            0: bytearray(0x204),
            _SBRM: bytearray(0x44),
            _SIRM: bytearray(0x30),
            _MANIFEST: bytearray(struct.pack("<Q", 1) + entry.pack()),
            _FEATURES: bytearray(0x200),
            _XML: bytearray(archive),
        }
        assert len(entry.pack()) == ENTRY
        for register, text in names.items():
            self._put(register, text.encode()[: STRING - 1])
        for address, size, value in (
            (Abrm.VERSION, 4, 0x00010000),
            (Abrm.RESPONSE_TIME, 4, RESPONSE_TIME),
            (Abrm.MANIFEST, 8, _MANIFEST),
            (Abrm.SBRM, 8, _SBRM),
            (_SBRM + Sbrm.VERSION, 4, 0x00010000),
            (_SBRM + Sbrm.LARGEST_COMMAND, 4, LARGEST_PACKET),
            (_SBRM + Sbrm.LARGEST_ANSWER, 4, LARGEST_PACKET),
            (_SBRM + Sbrm.STREAMS, 4, 1),
            (_SBRM + Sbrm.SIRM, 8, _SIRM),
            (_SBRM + Sbrm.SIRM_LENGTH, 4, 0x30),
            (_SBRM + Sbrm.SPEED, 4, 8),
            (_SIRM + Sirm.INFO, 4, _ALIGNMENT << 24),
            (_SIRM + Sirm.REQUIRED_LEADER, 4, 52),
            (_SIRM + Sirm.REQUIRED_TRAILER, 4, 32),
        ):
            self._put(address, value.to_bytes(size, "little"))

    def read(self, address: int, size: int) -> bytes:
        """What the host reads. Denied."""
        region, start = self._find(address, size)
        return bytes(region[start : start + size])

    def write(self, address: int, data: bytes) -> None:
        """What the host writes. Denied: only registers that are meant for it."""
        self._find(address, len(data))
        features = [feature for feature in Feature if feature not in (*READ_ONLY, Feature.BLACK_LEVEL)]
        stream = [_SIRM + register for register in _WRITABLE_SIRM]
        selected = [Feature.TRIGGER_CONTROL + 4, *(Feature.LINE_CONTROL + 4 * line for line in range(LINES))]
        if address not in (*features, *stream, *selected, Abrm.LATCH):
            raise Denied(Status.WRITE_PROTECTED)
        if len(data) != width(address):
            raise Denied(Status.BAD_PARAMETER)
        self._put(address, data)

    def get(self, feature: Feature, index: int = 0) -> int:
        """A register of 4 bytes; `index` counts on from its address."""
        return int.from_bytes(self.read(feature + 4 * index, 4), "little")

    def put(self, feature: Feature, value: int) -> None:
        """Set one."""
        self._put(feature, value.to_bytes(4, "little"))

    def get_float(self, feature: Feature) -> float:
        """A register of 8 bytes."""
        return float(struct.unpack("<d", self.read(feature, 8))[0])

    def put_float(self, feature: Feature, value: float, index: int = 0) -> None:
        """Set one."""
        self._put(feature + 8 * index, struct.pack("<d", value))

    def stream(self, register: Sirm) -> int:
        """A streaming register."""
        return int.from_bytes(self.read(_SIRM + register, 4), "little")

    def latch(self, nanoseconds: int) -> None:
        """Show what the device's clock was at."""
        self._put(Abrm.TIMESTAMP, nanoseconds.to_bytes(8, "little"))

    def require(self, payload: int) -> None:
        """Say how large frames are."""
        self._put(_SIRM + Sirm.REQUIRED_PAYLOAD, payload.to_bytes(8, "little"))

    def _find(self, address: int, size: int) -> tuple[bytearray, int]:
        for base, region in self._regions.items():
            if base <= address and address + size <= base + len(region):
                return region, address - base
        raise Denied(Status.BAD_ADDRESS)

    def _put(self, address: int, data: bytes) -> None:
        region, start = self._find(address, len(data))
        region[start : start + len(data)] = data

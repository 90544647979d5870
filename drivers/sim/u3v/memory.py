"""The memory of the simulated USB3 Vision camera: bootstrap registers, manifest, XML, features."""

import hashlib
import struct
from collections.abc import Mapping

from drivers.sim.genicam.description import zipped
from drivers.sim.genicam.memory import XML, FeatureMemory
from drivers.u3v.registers import ENTRY, STRING, Abrm, ManifestEntry, Sbrm, Sirm

LARGEST_PACKET = 1024
"""Bytes of the longest control packet, either way."""
RESPONSE_TIME = 200
"""Milliseconds that an answer may take."""
_SBRM, _SIRM, _MANIFEST = 0x1000, 0x2000, 0x3000
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


class DeviceMemory(FeatureMemory):
    """Little endian, as USB3 Vision is."""

    def __init__(self, names: Mapping[Abrm, str], xml: str) -> None:
        """names: the strings of the bootstrap registers."""
        archive = zipped(xml)
        sha1 = hashlib.sha1(archive, usedforsecurity=False).digest()
        entry = ManifestEntry((1, 0, 0), True, XML, len(archive), sha1)
        assert len(entry.pack()) == ENTRY
        regions = {
            0: bytearray(0x204),
            _SBRM: bytearray(0x44),
            _SIRM: bytearray(0x30),
            _MANIFEST: bytearray(struct.pack("<Q", 1) + entry.pack()),
        }
        writable = (*(_SIRM + register for register in _WRITABLE_SIRM), Abrm.LATCH)
        super().__init__(regions, archive, writable, "little")
        for register, text in names.items():
            self.put_bytes(register, text.encode()[: STRING - 1])
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
            self.put(address, value, size)

    def stream(self, register: Sirm) -> int:
        """A streaming register."""
        return self.get(_SIRM + register)

    def latch(self, nanoseconds: int) -> None:
        """Show what the device's clock was at."""
        self.put(Abrm.TIMESTAMP, nanoseconds, 8)

    def require(self, payload: int) -> None:
        """Report the size of frames."""
        self.put(_SIRM + Sirm.REQUIRED_PAYLOAD, payload, 8)

"""The memory of a simulated machine vision camera: regions of bytes, and the feature registers among them."""

import struct
from collections.abc import Container, Mapping

from drivers.genicam.chunks import ByteOrder
from drivers.sim.genicam.feature_registers import LINES, READ_ONLY, Feature
from drivers.u3v.gencp import Status

FEATURES, XML = 0x10000, 0x100000
"""Start addresses of feature registers and description."""
_FLOATS = {"little": "<d", "big": ">d"}


def width(address: int) -> int:
    """Bytes of a register that the host may write."""
    return 8 if address == Feature.EXPOSURE_TIME else 4


class Denied(Exception):
    """A read or a write that ends with a status, which GenCP and GVCP number alike."""

    def __init__(self, status: Status) -> None:
        super().__init__(status.name)
        self.status = status


class FeatureMemory:
    """Regions of bytes; what is not in one is not there."""

    def __init__(
        self, regions: Mapping[int, bytearray], archive: bytes, writable: Container[int], order: ByteOrder
    ) -> None:
        """regions: of the transport; archive: the description; writable: registers of the transport."""
        self.order: ByteOrder = order
        whole_words = archive + bytes(-len(archive) % 4)
        self._regions = {**regions, FEATURES: bytearray(0x200), XML: bytearray(whole_words)}
        self._of_transport = writable

    def read(self, address: int, size: int) -> bytes:
        """Return what the host reads. Denied."""
        region, start = self._find(address, size)
        return bytes(region[start : start + size])

    def write(self, address: int, data: bytes) -> None:
        """Write from the host. Denied for any register that it may not write."""
        self._find(address, len(data))
        features = [feature for feature in Feature if feature not in (*READ_ONLY, Feature.BLACK_LEVEL)]
        selected = [
            Feature.TRIGGER_CONTROL + 4,
            Feature.BALANCE_RATIO + 4,
            *(Feature.LINE_CONTROL + 4 * line for line in range(LINES)),
        ]
        if address not in (*features, *selected) and address not in self._of_transport:
            raise Denied(Status.WRITE_PROTECTED)
        if len(data) != width(address):
            raise Denied(Status.BAD_PARAMETER)
        self.put_bytes(address, data)

    def get(self, feature: int, index: int = 0) -> int:
        """A register of 4 bytes; `index` counts on from its address."""
        return int.from_bytes(self.read(feature + 4 * index, 4), self.order)

    def put(self, feature: int, value: int, size: int = 4) -> None:
        """Set one."""
        self.put_bytes(feature, value.to_bytes(size, self.order))

    def get_float(self, feature: Feature) -> float:
        """A register of 8 bytes."""
        return self.float_of(self.read(feature, 8))

    def put_float(self, feature: Feature, value: float, index: int = 0) -> None:
        """Set one."""
        self.put_bytes(feature + 8 * index, self.bytes_of(value))

    def float_of(self, data: bytes) -> float:
        """The number that 8 bytes are."""
        return float(struct.unpack(_FLOATS[self.order], data)[0])

    def bytes_of(self, value: float) -> bytes:
        """The 8 bytes of a number."""
        return struct.pack(_FLOATS[self.order], value)

    def put_bytes(self, address: int, data: bytes) -> None:
        """Set bytes, whatever they belong to."""
        region, start = self._find(address, len(data))
        region[start : start + len(data)] = data

    def _find(self, address: int, size: int) -> tuple[bytearray, int]:
        for base, region in self._regions.items():
            if base <= address and address + size <= base + len(region):
                return region, address - base
        raise Denied(Status.BAD_ADDRESS)

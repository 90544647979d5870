"""Nodes that are bytes in the device's memory: IntReg, MaskedIntReg, FloatReg, StringReg."""

import struct
from typing import Literal

from drivers.errors import CameraProtocol, CameraRefused
from drivers.genicam.nodemap.description import Element
from drivers.genicam.nodemap.formulas import SwissKnife
from drivers.genicam.nodemap.nodes import Limits, Node, Surroundings, Value, as_number, integral, numeric

_PLACE = frozenset(("Address", "pAddress", "pIndex"))
_OTHERS = frozenset(
    (
        *("AccessMode", "Bit", "Cachable", "Description", "DisplayName", "DisplayNotation"),
        *("DisplayPrecision", "DocuURL", "Endianess", "EventID", "Extension", "ImposedAccessMode"),
        *("IsDeprecated", "LSB", "Length", "MSB", "PollingTime", "Representation", "Sign", "Streamable"),
        *("ToolTip", "Unit", "Visibility", "pAlias", "pBlockPolling", "pCastAlias", "pError"),
        *("pInvalidator", "pIsAvailable", "pIsImplemented", "pIsLocked", "pLength", "pPort", "pSelected"),
    )
)
"""Elements that the GenApi schema 1.1 allows in a register besides its address. A register with other
elements may lie at another address than rig would use, and is refused.
"""


class Register(Node):
    """Bytes at an address; `get` and `set` of the kinds say what they mean."""

    longest = 1 << 16
    """Bytes that it can have."""

    def __init__(self, element: Element, around: Surroundings) -> None:
        super().__init__(element, around)
        big = (element.first("Endianess") or "LittleEndian").startswith("Big")
        self.order: Literal["big", "little"] = "big" if big else "little"
        self.signed = (element.first("Sign") or "Unsigned") == "Signed"
        self._knives = [SwissKnife(child, around) for child in element.all("IntSwissKnife")]

    def target_access(self) -> str:
        """AccessMode; registers that say nothing are read only."""
        return self.element.first("AccessMode") or "RO"

    def address(self) -> int:
        """The sum of all that the register says of its address. CameraProtocol if it says none."""
        tags = {child.tag for child in self.element.children}
        if unknown := tags - _PLACE - _OTHERS - {"IntSwissKnife"}:
            raise CameraProtocol(f"its register has a {min(unknown)}, which rig does not know")
        if not self._knives and not tags & _PLACE:
            raise CameraProtocol("its register has no address")
        total = sum(self._place(child) for child in self.element.children if child.tag in _PLACE)
        total += sum(integral(knife.get()) for knife in self._knives)
        if not 0 <= total < 1 << 64:
            raise CameraProtocol(f"its register is at {total}")
        return total

    def _place(self, child: Element) -> int:
        """Return what an Address, pAddress or pIndex adds to the address, bytes."""
        find = self.around.find
        if child.tag == "Address":
            return integral(as_number(child.text))
        place = integral(find(child.text).value())
        if child.tag == "pAddress":
            return place
        step, offset = child.attributes.get("Offset"), child.attributes.get("pOffset")
        if step is not None:
            return place * integral(as_number(step))
        return place * (self.size() if offset is None else integral(find(offset).value()))

    def size(self) -> int:
        """Length in bytes."""
        size = self.integer("Length")
        if size is None or not 0 < size <= self.longest:
            raise CameraProtocol(f"its register has {size} bytes")
        return size

    def read(self) -> bytes:
        """The bytes, from the device or from the frame's chunk."""
        address, size, chunk = self.address(), self.size(), self._chunk()
        if chunk is None:
            return self.around.memory.read(address, size)
        data = self.around.chunks.get(chunk)
        if data is None or address + size > len(data):
            raise CameraRefused("no chunk of the frame holds it: switch the chunk on")
        return data[address : address + size]

    def write(self, data: bytes) -> None:
        """Write the bytes."""
        if self._chunk() is not None:
            raise CameraRefused("what comes with a frame cannot be written")
        address = self.address()
        self.around.values.clear()
        self.around.memory.write(address, data)

    def _chunk(self) -> int | None:
        """The ChunkID of the port, if it is one of chunks; it is written in hexadecimal."""
        port = self.refer("pPort")
        if port is None:
            return None
        for tag in ("EventID", "pChunkID"):
            if port.element.all(tag):
                raise CameraProtocol(f"its port has a {tag}, which rig does not know")
        chunk = port.element.first("ChunkID")
        try:
            return None if chunk is None else int(chunk, 16)
        except ValueError:
            raise CameraProtocol(f"{chunk!r} is no ChunkID") from None


class IntRegister(Register):
    """IntReg: the whole register is a number."""

    longest = 8

    def get(self) -> int:
        """The number."""
        return int.from_bytes(self.read(), self.order, signed=self.signed)

    def set(self, value: Value) -> None:
        """Write the number."""
        number = integral(value)
        self.limits().check(number)
        self.write(number.to_bytes(self.size(), self.order, signed=self.signed))

    def limits(self) -> Limits:
        """Return what the bits can hold."""
        return _of_bits(8 * self.size(), self.signed)


class MaskedIntRegister(Register):
    """MaskedIntReg and StructEntry: some bits of a register; the others stay as they are."""

    longest = 8

    def get(self) -> int:
        """The number in the bits."""
        shift, width = self._bits()
        number = int.from_bytes(self.read(), self.order) >> shift & (1 << width) - 1
        return number - (1 << width) if self.signed and number >> (width - 1) else number

    def set(self, value: Value) -> None:
        """Write the bits."""
        number = integral(value)
        self.limits().check(number)
        shift, width = self._bits()
        mask = (1 << width) - 1
        # A register that cannot be read is written with nothing else in it.
        before = 0 if self.target_access() == "WO" else int.from_bytes(self.read(), self.order)
        after = before & ~(mask << shift) | (number & mask) << shift
        self.write(after.to_bytes(self.size(), self.order))

    def limits(self) -> Limits:
        """Return what the bits can hold."""
        return _of_bits(self._bits()[1], self.signed)

    def _bits(self) -> tuple[int, int]:
        """The place of the lowest bit above the register's lowest, and how many bits."""
        single = self.integer("Bit")
        first, last = (self.integer("LSB"), self.integer("MSB")) if single is None else (single, single)
        total = 8 * self.size()
        if first is None or last is None or not (0 <= first < total and 0 <= last < total):
            raise CameraProtocol(f"its bits are {first} to {last} of {total}")
        if self.order == "big":
            # There bit 0 is the highest.
            first, last = total - 1 - first, total - 1 - last
        low, high = min(first, last), max(first, last)
        return low, high - low + 1


class FloatRegister(Register):
    """FloatReg: IEEE single or double."""

    def get(self) -> float:
        """The number."""
        return float(struct.unpack(self._format(), self.read())[0])

    def set(self, value: Value) -> None:
        """Write the number."""
        try:
            data = struct.pack(self._format(), float(numeric(value)))
        except OverflowError:
            raise CameraRefused(f"{value} is too large: give another value") from None
        self.write(data)

    def _format(self) -> str:
        kind = {4: "f", 8: "d"}.get(self.size())
        if kind is None:
            raise CameraProtocol(f"a float of {self.size()} bytes is unknown")
        return (">" if self.order == "big" else "<") + kind


class StringRegister(Register):
    """StringReg: text up to the first NUL."""

    def get(self) -> str:
        """The text."""
        return self.read().split(b"\0")[0].decode("utf-8", "replace")

    def set(self, value: Value) -> None:
        """Write the text, filled up with NULs."""
        data, size = str(value).encode(), self.size()
        if len(data) > size:
            raise CameraRefused(f"{value!r} is longer than {size} bytes: give a shorter text")
        self.write(data.ljust(size, b"\0"))


def _of_bits(bits: int, signed: bool) -> Limits:
    low = -(1 << (bits - 1)) if signed else 0
    return Limits(low, low + (1 << bits) - 1)

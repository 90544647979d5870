"""TIFF directories as bytes: what a DNG file and an EXIF block have in common.

Written is the classic 32-bit layout (TIFF 6.0); read is BigTIFF as well, in both byte orders. Reading is
defensive: the bytes may be damaged, so every offset and count is checked and only `TiffError` is raised.

Every tag that is used for light is read here. Two libraries read what this does not: tifffile decodes the
pixels of TIFF images (`image`), and ExifRead finds EXIF in RAW files that are no TIFF (`raw_exif`). Neither
takes its place: on damaged bytes they log, and raise whatever they trip over.
"""

import math
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import BinaryIO

BYTE, ASCII, SHORT, LONG, RATIONAL, UNDEFINED, SRATIONAL, DOUBLE = 1, 2, 3, 4, 5, 7, 10, 12

_FORMATS = {1: "B", 3: "H", 4: "I", 6: "b", 8: "h", 9: "i", 11: "f", 12: "d", 13: "I"}
_FORMATS |= {16: "Q", 17: "q", 18: "Q"}  # BigTIFF's
_SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 13: 4}
_SIZES |= {16: 8, 17: 8, 18: 8}

_MOST_READ = 4
"""Bytes of values for each byte of a file: a directory may be read several times."""

SUB_IFDS, EXIF_IFD = 330, 34665

_VITAL = frozenset(
    (*range(254, 269), *range(273, 280), 284, 290, 291, 301, *range(317, 348), *range(529, 533))
)
_VITAL |= {33421, 33422, 34675, *range(50706, 53000)}
"""Tags whose loss would show other light, or hide lost pixels: of images, of their colours, and DNG's."""

_LARGEST_VALUE = 1 << 24
"""Bytes of one tag's value beyond which it is damage, or a preview that is not needed here."""

Value = bytes | str | tuple[int, ...] | tuple[float, ...] | tuple[Fraction | None, ...]
Directory = dict[int, Value]
"""Tag to value: str for ASCII, bytes for UNDEFINED, else a tuple; a rational x/0 is None."""


class TiffError(Exception):
    """The bytes are not a TIFF, or are damaged; never leaves `imaging`."""


@dataclass(frozen=True)
class Entry:
    """A tag to be written: a TIFF type and its values (text for ASCII, bytes for UNDEFINED)."""

    kind: int
    values: str | bytes | Sequence[int | float | Fraction]

    def encoded(self) -> tuple[int, bytes]:
        """Count and little-endian bytes."""
        if isinstance(self.values, str):
            text = self.values.encode() + b"\0"
            return len(text), text
        if isinstance(self.values, bytes):
            return len(self.values), self.values
        if self.kind in (RATIONAL, SRATIONAL):
            form = "<II" if self.kind == RATIONAL else "<ii"
            pairs = [Fraction(value) for value in self.values]
            return len(pairs), b"".join(struct.pack(form, v.numerator, v.denominator) for v in pairs)
        return len(self.values), struct.pack(f"<{len(self.values)}{_FORMATS[self.kind]}", *self.values)


def rational(value: float, *, signed: bool = False) -> Fraction:
    """The simplest fraction of 32-bit parts that is `value`, or the nearest one there is.

    Relative error below 1e-9 for 1e-5 <= |value| <= 1e5. ValueError if it is out of range or no number.
    """
    largest = 2**31 - 1 if signed else 2**32 - 1
    if not math.isfinite(value):
        raise ValueError(f"{value} is no TIFF rational")
    exact = Fraction(value)
    if abs(exact) > largest or (exact < 0 and not signed):
        raise ValueError(f"{value} does not fit a TIFF rational")
    widest = max(1, int(largest / max(1, -(-abs(exact) // 1))))
    for limit in (10**3, 10**6, widest):
        nearest = exact.limit_denominator(min(limit, widest))
        if float(nearest) == value:
            break
    return nearest


def encode_directory(entries: Mapping[int, Entry], offset: int) -> bytes:
    """A directory that will stand at `offset` (even) of a little-endian file, with its values behind it.

    Tags ascending, values word-aligned, no next directory.
    """
    head = struct.pack("<H", len(entries))
    values = b""
    start = offset + 2 + 12 * len(entries) + 4
    for tag in sorted(entries):
        count, data = entries[tag].encoded()
        head += struct.pack("<HHI", tag, entries[tag].kind, count)
        if len(data) <= 4:
            head += data.ljust(4, b"\0")
        else:
            head += struct.pack("<I", start + len(values))
            values += data + b"\0" * (len(data) % 2)
    return head + struct.pack("<I", 0) + values


class TiffReader:
    """Directories of a TIFF in a seekable binary file (or of an EXIF block in a BytesIO)."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.size = file.seek(0, 2)
        self._taken = 0
        head = self.read(0, 8)
        orders = {b"II*\0": "<", b"MM\0*": ">", b"II+\0": "<", b"MM\0+": ">"}
        if head[:4] not in orders:
            raise TiffError("no TIFF header")
        self._order = orders[head[:4]]
        self._big = b"+" in head[:4]
        self.first: int = self._unpack(*(("Q", self.read(8, 8)) if self._big else ("I", head[4:])))[0]
        """Offset of the first directory."""

    def directories(self) -> list[Directory]:
        """Every directory: the chain of IFDs and below each its SubIFDs; the EXIF IFD stands apart."""
        return [directory for _, directory in self.walk()]

    def walk(self) -> Iterator[tuple[int, Directory]]:
        """Offset and values of every directory in the order of `directories`, each read when asked for."""
        waiting, visited = [self.first], set[int]()
        while waiting:
            offset = waiting.pop(0)
            if offset == 0 or offset in visited:
                continue
            visited.add(offset)
            if len(visited) > 64:
                raise TiffError("too many directories")
            directory, following = self.directory(offset)
            yield offset, directory
            waiting += [*integers(directory, SUB_IFDS), following]

    def directory(self, offset: int) -> tuple[Directory, int]:
        """The directory at `offset`, and the offset of the next (0: none).

        A tag whose value lies beyond the file is left out, since editors drop the bytes of a note and leave
        its entry; TiffError for one that the pixels need (`_VITAL`).
        """
        counted, entry, place = ("Q", "HHQ8s", "Q") if self._big else ("H", "HHI4s", "I")
        lead, step, room = (struct.calcsize(f"={form}") for form in (counted, entry, place))
        (count,) = self._unpack(counted, self.read(offset, lead))
        table = self.read(offset + lead, step * count + room)
        directory: Directory = {}
        for index in range(count):
            tag, kind, number, inline = self._unpack(entry, table[step * index : step * (index + 1)])
            if kind not in _SIZES:
                continue
            length, at = _SIZES[kind] * number, self._unpack(place, inline)[0]
            if length > _LARGEST_VALUE:
                continue
            if room < length and at + length > self.size and (kind == ASCII or tag not in _VITAL):
                continue
            # values that many tags share would fill the memory
            self._taken += length
            if self._taken > _MOST_READ * max(self.size, 1 << 16):
                raise TiffError("more values than bytes")
            data = inline[:length] if length <= room else self.read(at, length)
            directory[tag] = self._decoded(kind, data)
        return directory, self._unpack(place, table[-room:])[0]

    def place(self, offset: int, tag: int) -> int:
        """Offset of the value of a tag of the directory at `offset`; TiffError if it has no such tag."""
        counted, entry, inner = ("Q", "HHQ8s", "Q") if self._big else ("H", "HHI4s", "I")
        lead, step, room = (struct.calcsize(f"={form}") for form in (counted, entry, inner))
        (count,) = self._unpack(counted, self.read(offset, lead))
        for at in range(offset + lead, offset + lead + step * count, step):
            number_of_tag, kind, number, inline = self._unpack(entry, self.read(at, step))
            if number_of_tag == tag and kind in _SIZES:
                short = _SIZES[kind] * number <= room
                return at + step - room if short else int(self._unpack(inner, inline)[0])
        raise TiffError("the tag is missing")

    def _decoded(self, kind: int, data: bytes) -> Value:
        if kind == ASCII:
            return data.split(b"\0")[0].decode("utf-8", "replace").strip()
        if kind == UNDEFINED:
            return data
        if kind in (RATIONAL, SRATIONAL):
            parts = self._unpack(f"{len(data) // 4}{'I' if kind == RATIONAL else 'i'}", data)
            return tuple(
                Fraction(above, below) if below else None
                for above, below in zip(parts[::2], parts[1::2], strict=True)
            )
        return self._unpack(f"{len(data) // _SIZES[kind]}{_FORMATS[kind]}", data)

    def _unpack(self, form: str, data: bytes) -> tuple:  # type: ignore[type-arg]
        return struct.unpack(self._order + form, data)

    def read(self, offset: int, length: int) -> bytes:
        """Bytes of the file; TiffError if it ends before them."""
        if offset + length > self.size:
            raise TiffError("an offset leads past the end")
        self._file.seek(offset)
        return self._file.read(length)


def numbers(directory: Directory, tag: int) -> tuple[float, ...]:
    """The values of a tag as floats; empty if it is missing, is no number or has a value x/0."""
    values = directory.get(tag, ())
    if isinstance(values, str | bytes) or any(value is None for value in values):
        return ()
    return tuple(float(value) for value in values if value is not None)


def integers(directory: Directory, tag: int) -> tuple[int, ...]:
    """The values of a tag that are whole numbers, as ints."""
    values = directory.get(tag, ())
    if isinstance(values, str | bytes):
        return ()
    return tuple(value for value in values if isinstance(value, int))


def text(directory: Directory, tag: int) -> str:
    """A tag as text; '' if it is missing or no text."""
    value = directory.get(tag, "")
    return value if isinstance(value, str) else ""

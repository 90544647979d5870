"""Places of the vertices in a PLY file, the form in which nerfstudio keeps its scene points.

http://paulbourke.net/dataformats/ply/: a header in text that names elements and their properties, then
their values as text or as little-endian binary.
"""

from pathlib import Path

import numpy as np
import numpy.typing as npt

from imaging.compute.memory import check
from imaging.errors import InputError

_TYPES = {
    **dict.fromkeys(("char", "int8"), "<i1"),
    **dict.fromkeys(("uchar", "uint8"), "<u1"),
    **dict.fromkeys(("short", "int16"), "<i2"),
    **dict.fromkeys(("ushort", "uint16"), "<u2"),
    **dict.fromkeys(("int", "int32"), "<i4"),
    **dict.fromkeys(("uint", "uint32"), "<u4"),
    **dict.fromkeys(("float", "float32"), "<f4"),
    **dict.fromkeys(("double", "float64"), "<f8"),
}
_END = b"end_header"
_PER_BYTE = 32
"""Bytes of memory that the numbers of a text take for each of its bytes."""


def read_ply_points(path: Path) -> npt.NDArray[np.float64]:
    """x, y, z of every vertex, float64 [P, 3]; InputError unless vertices come first and all are there."""
    try:
        check(f"{path} is a large file", path.stat().st_size)
        return _points(path.read_bytes(), path)
    except OSError as error:
        raise InputError(f"{path} cannot be read: copy it again or take its name out.") from error
    except (ValueError, KeyError, IndexError, OverflowError, MemoryError) as error:
        raise InputError(
            f"{path} is no PLY file of points, or it is cut off: copy it again or take its name out."
        ) from error


def _points(data: bytes, path: Path) -> npt.NDArray[np.float64]:
    start = data.index(b"\n", data.index(_END)) + 1
    lines = [line.split() for line in data[:start].decode("ascii").splitlines()]
    if lines[0] != ["ply"]:
        raise ValueError("no PLY")
    (form,) = (line[1] for line in lines if line[:1] == ["format"])
    elements = [number for number, line in enumerate(lines) if line[:1] == ["element"]]
    if lines[elements[0]][1] != "vertex":
        raise ValueError("vertices do not come first")
    count = int(lines[elements[0]][2])
    mine = lines[elements[0] : [*elements[1:], len(lines)][0]]
    fields = np.dtype([(line[2], _TYPES[line[1]]) for line in mine if line[:1] == ["property"]])
    if not 0 <= count * fields.itemsize <= 100 * len(data):
        raise ValueError("cut off")
    check(f"{path} has {count} points", count * 48 + (_PER_BYTE * len(data) if form == "ascii" else 0))
    if form == "binary_little_endian":
        table = np.frombuffer(data, fields, count, start)
        return np.stack([table[axis].astype(np.float64) for axis in "xyz"], axis=1)
    if form != "ascii":
        raise ValueError(form)
    names = list(fields.names or ())
    cells = data[start:].split()[: count * len(names)]
    values = np.array(cells, np.float64).reshape(count, len(names))
    return values[:, [names.index(axis) for axis in "xyz"]]

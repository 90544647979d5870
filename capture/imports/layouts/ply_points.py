"""Places of the vertices in a PLY file, the form in which nerfstudio keeps its scene points.

http://paulbourke.net/dataformats/ply/: a header in text that names elements and their properties, then
their values as text or as binary of either byte order. Programs call the places x, y, z, or px, py, pz.
"""

import re
from pathlib import Path

import numpy as np

from imaging.arrays import Array
from imaging.compute.memory import check
from imaging.errors import InputError

_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
_END = re.compile(rb"^end_header[ \t]*\r?\n", re.MULTILINE)
_ORDER = {"binary_little_endian": "<", "binary_big_endian": ">"}
_NAMES = (("x", "y", "z"), ("px", "py", "pz"), ("pos_x", "pos_y", "pos_z"))
_PER_BYTE = 32
"""Bytes of memory that the numbers of a text take for each of its bytes."""


def read_ply_points(path: Path) -> Array:
    """x, y, z of every vertex, float64 [P, 3]; InputError unless there are vertices, and all of them."""
    try:
        check(f"{path} is a large file", path.stat().st_size)
        return _points(path.read_bytes(), path)
    except OSError as error:
        raise InputError(f"{path} cannot be read: copy it again or take its name out.") from error
    except (ValueError, KeyError, IndexError, OverflowError, MemoryError, StopIteration) as error:
        raise InputError(
            f"{path} is not a PLY file of points, or it is truncated: copy it again or remove its name."
        ) from error


def _points(data: bytes, path: Path) -> Array:
    end = _END.search(data)
    if end is None:
        raise ValueError("no end of the header")
    start = end.end()
    lines = [line.split() for line in data[:start].decode("utf-8", "replace").splitlines()]
    if lines[0] != ["ply"]:
        raise ValueError("no PLY")
    (form,) = (line[1] for line in lines if line[:1] == ["format"])
    starts = [number for number, line in enumerate(lines) if line[:1] == ["element"]]
    rows_before = 0
    for first, last in zip(starts, [*starts[1:], len(lines)], strict=True):
        count = int(lines[first][2])
        fields = np.dtype(
            [
                (line[2].casefold(), _ORDER.get(form, "<") + _TYPES[line[1]])
                for line in lines[first:last]
                if line[:1] == ["property"]
            ]
        )
        if lines[first][1] == "vertex":
            break
        start += count * fields.itemsize if form != "ascii" else 0
        rows_before += count * len(fields.names or ()) if form == "ascii" else 0
    else:
        raise ValueError("no vertices")
    if not 0 <= count * fields.itemsize <= 100 * len(data):
        raise ValueError("cut off")
    check(f"{path} has {count} points", count * 48 + (_PER_BYTE * len(data) if form == "ascii" else 0))
    names = list(fields.names or ())
    axes = next(axes for axes in _NAMES if set(axes) <= set(names))
    if form in _ORDER:
        table = np.frombuffer(data, fields, count, start)
        return np.stack([table[axis].astype(np.float64) for axis in axes], axis=1)
    if form != "ascii":
        raise ValueError(form)
    cells = data[start:].split()[rows_before:][: count * len(names)]
    values = np.array(cells, np.float64).reshape(count, len(names))
    return values[:, [names.index(axis) for axis in axes]]

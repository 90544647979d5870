"""PLY files of vertices, read back."""

import re
from pathlib import Path

import numpy as np

from imaging.arrays import Array32

KINDS = {"float": "<f4", "uchar": "u1"}


def read_ply(path: Path, *, faces: bool = False) -> dict[str, Array32]:
    """Every property of the vertices of a binary little-endian PLY, by name: float32 [N] each.

    faces: whether faces may follow.
    """
    head, end, body = path.read_bytes().partition(b"end_header\n")
    lines = head.decode("ascii").split("\n")
    assert end
    assert "format binary_little_endian 1.0" in lines
    (count,) = (int(line.split()[-1]) for line in lines if line.startswith("element vertex "))
    properties = (re.fullmatch(r"property (float|uchar) (\w+)", line) for line in lines)
    fields = np.dtype([(one[2], KINDS[one[1]]) for one in properties if one])
    assert faces or len(body) == count * fields.itemsize
    table = np.frombuffer(body, fields, count)
    return {name: table[name].astype(np.float32) for name in fields.names or ()}

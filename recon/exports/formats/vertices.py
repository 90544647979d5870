"""Coloured vertices as binary PLY: what screens show, as programs read it, and the light itself beside it."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from imaging.arrays import Bytes
from imaging.colour.spaces import srgb_encode

_SHOWN = ("red", "green", "blue")
_LIGHT = tuple(f"radiance_{name}" for name in _SHOWN)


def shown(light: npt.ArrayLike) -> Bytes:
    """Linear Rec.709 [N, 3], 1 being white, as 8 bits of sRGB."""
    return np.round(255 * srgb_encode(np.clip(np.asarray(light, np.float64), 0, 1))).astype(np.uint8)


def packed_vertices(
    places: npt.ArrayLike,
    codes: Bytes,
    comments: Sequence[str],
    *,
    light: npt.ArrayLike | None = None,
    faces: npt.NDArray[np.integer] | None = None,
) -> bytes:
    """A file of coloured vertices, binary PLY.

    Args:
        places: [N, 3], written as float32.
        codes: Colours [N, 3] as screens show them.
        comments: Lines of the header.
        light: Linear colours [N, 3], written as float32 properties of their own.
        faces: Triangles [M, 3] by the rows of their vertices.

    Returns:
        The bytes of the file.
    """
    fields = [(axis, "<f4") for axis in "xyz"] + [(name, "u1") for name in _SHOWN]
    columns = [*np.asarray(places).T, *codes.T]
    if light is not None:
        fields += [(name, "<f4") for name in _LIGHT]
        columns += [*np.asarray(light).T]
    table = np.empty(len(codes), fields)
    for (name, _), column in zip(fields, columns, strict=True):
        table[name] = column
    header = [
        "ply",
        "format binary_little_endian 1.0",
        *(f"comment {line}" for line in comments),
        f"element vertex {len(table)}",
        *(f"property {'uchar' if kind == 'u1' else 'float'} {name}" for name, kind in fields),
    ]
    body = table.tobytes()
    if faces is not None:
        header += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
        corners = np.empty(len(faces), [("count", "u1"), ("rows", "<i4", 3)])
        corners["count"], corners["rows"] = 3, faces
        body += corners.tobytes()
    return "\n".join([*header, "end_header", ""]).encode("ascii", "replace") + body

"""Reading of PLY files in the layout of 3DGS (`recon.scene.ply`), whichever program wrote them."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from imaging.arrays import Array
from imaging.compute import memory
from imaging.errors import InputError
from recon.data.world import Vector
from recon.scene.ply import properties

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
_MOST_HEADER = 1 << 20
_PER_BYTE = 4
"""Bytes of memory that the numbers of a file take for each of its bytes, float32 and twice float64."""
_DEGREE_3 = 16
"""Coefficients of the highest degree that files have."""
_MOVING = re.compile(r"t|scale_t|(trbf|motion|omega|rot_r)_\w+")
"""Properties of Gaussians that move (Spacetime Gaussians, arXiv 2312.16812; 4DGS, arXiv 2310.10642)."""
_SHAPED = ("shape", "beta", "nu_degree")
"""Properties of splats of other falloffs (arXiv 2402.10128, 2501.18630, 2503.10148)."""
FILTER = "filter_3D"
"""Property of Mip-Splatting (arXiv 2311.16493): a deviation by which each Gaussian is widened."""
MIP_BLUR = 0.1
"""Variance, px^2, of the 2D filter that Mip-Splatting trains and draws with."""


@dataclass(frozen=True, eq=False)
class PlySplats:
    """N Gaussians of a file, float64, as `properties` describes them.

    means [N, 3]; log_scales [N, 3]; quats [N, 4] wxyz, any length; logits [N] of the opacities; harmonics
    [N, (degree + 1)^2, 3], up to degree 3. comments: of the header, in order. linear: whether the file says
    that colours are linear light. made_up: variance, px^2, of a blur whose widening they were trained to make
    up for by less opacity (the 2D filter of Mip-Splatting); None: drawn as 3DGS does.
    """

    means: Array
    log_scales: Array
    quats: Array
    logits: Array
    harmonics: Array
    comments: tuple[str, ...]
    linear: bool = False
    made_up: float | None = None

    def __len__(self) -> int:
        return len(self.means)


def stated_offset(text: str) -> Vector | None:
    """Read a line as `rig export` has it in comments, `offset X Y Z: add it to x y z`, or return None."""
    match = re.search(r"^offset (\S+) (\S+) (\S+): add it", text, re.MULTILINE)
    if match is None:
        return None
    try:
        x, y, z = map(float, match.groups())
    except ValueError:
        return None
    return (x, y, z) if all(map(math.isfinite, (x, y, z))) else None


def read_ply(path: Path) -> PlySplats:
    """Read Gaussians in the layout of 3DGS of any program; InputError for another PLY and for damage."""
    try:
        with path.open("rb") as file:
            head = file.read(_MOST_HEADER)
            end = re.search(rb"\nend_header\r?\n", head)
            if not head.startswith(b"ply") or end is None:
                raise InputError(f"{path} is not a PLY file: name one in the layout of 3DGS.")
            lines = head[: end.start()].decode("ascii", "replace").splitlines()
            table, count = _vertices(path, lines), _count(lines)
            named = set(table.names or ())
            if path.stat().st_size - end.end() < table.itemsize * count:
                raise InputError(f"{path} ends before its last Gaussian: copy it again.")
            memory.check(f"{path} has {count} Gaussians", _PER_BYTE * table.itemsize * count)
            file.seek(end.end())
            body = file.read(table.itemsize * count)
            linear = _is_linear(lines, file.read(_MOST_HEADER))
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}): correct the path.") from error
    if not count:
        raise InputError(f"{path} holds no Gaussian: export it again.")
    rows = np.frombuffer(body, table)

    def columns(*names: str) -> Array:
        return np.stack([rows[name].astype(np.float64) for name in names], axis=-1)

    others = sum(name.startswith("f_rest_") for name in table.names or ())
    constant = columns("f_dc_0", "f_dc_1", "f_dc_2")[:, None]
    rest = columns(*(f"f_rest_{index}" for index in range(others))) if others else np.empty((len(rows), 0))
    rest = rest.reshape(len(rows), 3, others // 3).transpose(0, 2, 1)
    log_scales, logits = columns("scale_0", "scale_1", "scale_2"), columns("opacity")[:, 0]
    if FILTER in named:
        log_scales, logits = _widened(log_scales, logits, columns(FILTER))
    return PlySplats(
        means=columns("x", "y", "z"),
        log_scales=log_scales,
        quats=columns("rot_0", "rot_1", "rot_2", "rot_3"),
        logits=logits,
        harmonics=np.concatenate([constant, rest], axis=1),
        comments=tuple(line[8:] for line in lines if line.startswith("comment ")),
        linear=linear,
        made_up=MIP_BLUR if FILTER in named else None,
    )


def _widened(log_scales: Array, logits: Array, deviations: Array) -> tuple[Array, Array]:
    """Scales and opacities with the 3D filter [N, 1] of Mip-Splatting, which keeps the mass of each."""
    with np.errstate(all="ignore"):  # of what is not finite no Gaussian is made
        variances = 2 * log_scales
        wide = np.logaddexp(variances, 2 * np.log(np.abs(deviations)))
        opacity = (variances - wide).sum(axis=1) / 2 - np.logaddexp(0, -logits)
        return wide / 2, opacity - np.log(-np.expm1(opacity))


def _is_linear(lines: Sequence[str], rest: bytes) -> bool:
    """Return whether the element `color_space` of SHARP (arXiv 2512.10685), 0 or 1, says linear light.

    rest: the bytes behind the Gaussians. Elements with lists are not read.
    """
    order = ">" if any("big_endian" in line for line in lines if line.startswith("format ")) else "<"
    place, element, count = 0, "", 0
    for line in lines:
        words = line.split()
        if words[:1] == ["element"] and len(words) == 3 and words[2].isdigit():
            element, count = words[1], int(words[2])
        elif words[:1] == ["property"] and element not in ("", "vertex"):
            if len(words) != 3 or words[1] not in _TYPES:
                return False
            kind = np.dtype(order + _TYPES[words[1]])
            if element == "color_space":
                value = rest[place : place + kind.itemsize]
                return len(value) == kind.itemsize and bool(np.frombuffer(value, kind)[0])
            place += count * kind.itemsize
    return False


def _count(lines: Sequence[str]) -> int:
    return next(int(line.split()[2]) for line in lines if re.fullmatch(r"element vertex \d+\s*", line))


def _vertices(path: Path, lines: Sequence[str]) -> np.dtype[np.void]:
    """The layout of a vertex; InputError unless it is a Gaussian in binary, before all other elements."""
    elements = [line.split()[1:2] for line in lines if line.startswith("element ")]
    if elements[:1] == [["chunk"]]:
        raise InputError(
            f"{path} is a compressed PLY of PlayCanvas: convert it by `splat-transform {path.name} x.ply`."
        )
    order = {"format binary_little_endian 1.0": "<", "format binary_big_endian 1.0": ">"}
    sign = next((order[line.strip()] for line in lines if line.strip() in order), None)
    if (
        sign is None
        or elements[:1] != [["vertex"]]
        or not any(re.match(r"element vertex \d+\s*$", x) for x in lines)
    ):
        raise InputError(f"{path} holds no Gaussians in binary: name a PLY in the layout of 3DGS.")
    start = next(place for place, line in enumerate(lines) if line.startswith("element vertex "))
    fields = []
    for line in lines[start + 1 :]:
        words = line.split()
        if words[:1] == ["element"]:
            break
        if words[:1] == ["property"]:
            if len(words) != 3 or words[1] not in _TYPES:
                raise InputError(f"{path} has the property {line!r}: name a PLY in the layout of 3DGS.")
            fields.append((words[2], sign + _TYPES[words[1]]))
    names = [name for name, _ in fields]
    rest = sum(name.startswith("f_rest_") for name in names)
    degree = math.isqrt(rest // 3 + 1) - 1
    wanted = {*properties(0), *(f"f_rest_{index}" for index in range(rest))}
    if len(set(names)) < len(names) or not wanted <= set(names) or rest != 3 * ((degree + 1) ** 2 - 1):
        missing = ", ".join(sorted(wanted - set(names))) or "an odd number of f_rest"
        raise InputError(f"{path} is a PLY without {missing}: name one in the layout of 3DGS.")
    moving = next((name for name in names if _MOVING.fullmatch(name)), None)
    if moving is not None:
        raise InputError(f"{path} has Gaussians that move ({moving}): export one moment as a PLY of 3DGS.")
    shaped = next((name for name in names if name in _SHAPED), None)
    if shaped is not None:
        raise InputError(f"{path} has splats that are not valid Gaussians ({shaped}): name a PLY of 3DGS.")
    if rest // 3 + 1 > _DEGREE_3:
        raise InputError(f"{path} has harmonics of degree {degree}: name a PLY of degree 3 or lower.")
    return np.dtype(fields)

"""PLY files in the layout of 3DGS, which viewers read."""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from imaging.arrays import Array, Floats
from imaging.compute import memory
from imaging.errors import InputError
from imaging.files import store
from recon.data.world import SAME, Vector, WorldTransform
from recon.scene.appearance import Appearance, PlainHarmonics
from recon.scene.gaussians import Gaussians
from recon.scene.harmonics import basis, sphere


def properties(degree: int) -> tuple[str, ...]:
    """Names of a Gaussian's numbers, little-endian float32 each, with harmonics of a degree.

    Colour towards direction d: max(0, 0.5 + SH(d)), the harmonics as in 3DGS; f_rest holds all of red, then
    green, then blue, and viewers derive the degree from their number. opacity is a logit, scales are natural
    logarithms, rot is wxyz. The comments state whether colours are display values or light. The normals of
    the first 3DGS files, all zero, are left out, as gsplat and PlayCanvas do.
    """
    return (
        *("x", "y", "z"),
        *(f"f_dc_{channel}" for channel in range(3)),
        *(f"f_rest_{index}" for index in range(3 * ((degree + 1) ** 2 - 1))),
        "opacity",
        *(f"scale_{axis}" for axis in range(3)),
        *(f"rot_{part}" for part in range(4)),
    )


def plain_harmonics(gaussians: Gaussians, appearance: Appearance, degree: int) -> Array:
    """The appearance as the plain series of 3DGS: float64 [N, (degree + 1)^2, 3], see `properties`.

    Of `PlainHarmonics` its own coefficients; of the others, of linear radiance in scene units, those that are
    nearest.
    """
    parameters = gaussians.parameters
    if isinstance(appearance, PlainHarmonics):
        parts = [parameters[name].detach().double().numpy() for name in ("sh_dc", "sh_rest")]
        return np.concatenate(parts, axis=1)[:, : (degree + 1) ** 2]

    def colours(towards: torch.Tensor) -> Array:
        return appearance.colours(parameters, towards, degree).detach().double().numpy()

    return fitted_harmonics(colours, len(gaussians), degree)


def fitted_harmonics(colours: Callable[[torch.Tensor], Array], count: int, degree: int) -> Array:
    """The series of 3DGS that is nearest to the colours of `count` Gaussians: [count, (degree + 1)^2, 3].

    `colours` [count, 3] are asked for towards directions [count, 3] (camera to Gaussian), all the same; least
    squares over directions spread evenly over the sphere.
    """
    directions = torch.from_numpy(sphere())
    inverse = np.linalg.pinv(basis(directions, degree).numpy())  # in float64: light is added to one half
    total = np.zeros((count, len(inverse), 3))
    for column, direction in enumerate(directions.float()):
        total += inverse[:, column][None, :, None] * (colours(direction.expand(count, 3)) - 0.5)[:, None]
    return total


def write_ply(
    path: Path,
    gaussians: Gaussians,
    harmonics: Floats,
    comments: Sequence[str],
    world: WorldTransform = SAME,
    offset: Vector = (0.0, 0.0, 0.0),
) -> None:
    """Write the Gaussians with the colours of `plain_harmonics`, each of `comments` on a line of its own.

    Coordinates are those of the world less `offset`.
    """
    count = len(gaussians)
    parameters = {name: value.detach().numpy() for name, value in gaussians.parameters.items()}
    quats = parameters["quats"] / np.linalg.norm(parameters["quats"], axis=1, keepdims=True).clip(1e-12)
    columns = [
        world.to_world(parameters["means"]) - offset,
        harmonics[:, 0],
        harmonics[:, 1:].transpose(0, 2, 1).reshape(count, -1),
        parameters["opacity_logits"][:, None],
        parameters["log_scales"].astype(np.float64) + np.log(world.unit),
        quats,
    ]
    header = ["ply", "format binary_little_endian 1.0", *(f"comment {comment}" for comment in comments)]
    names = properties(math.isqrt(harmonics.shape[1]) - 1)
    header += [f"element vertex {count}", *(f"property float {name}" for name in names), "end_header"]
    body = np.concatenate(columns, axis=1).astype("<f4").tobytes()
    store.write_bytes(path, ("\n".join(header) + "\n").encode("ascii") + body)


def most_gaussians(size: float, degree: int) -> int:
    """Maximum number of Gaussians of a degree in a file of `size` bytes, its header taken at 2000 bytes."""
    return max(0, int((size - 2000) // (4 * len(properties(degree)))))


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


@dataclass(frozen=True, eq=False)
class PlySplats:
    """N Gaussians of a file, float64, as `properties` describes them.

    means [N, 3]; log_scales [N, 3]; quats [N, 4] wxyz, any length; logits [N] of the opacities; harmonics
    [N, (degree + 1)^2, 3], up to degree 3. comments: of the header, in order.
    """

    means: Array
    log_scales: Array
    quats: Array
    logits: Array
    harmonics: Array
    comments: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.means)


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
            if path.stat().st_size - end.end() < table.itemsize * count:
                raise InputError(f"{path} ends before its last Gaussian: copy it again.")
            memory.check(f"{path} has {count} Gaussians", _PER_BYTE * table.itemsize * count)
            file.seek(end.end())
            body = file.read(table.itemsize * count)
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
    return PlySplats(
        means=columns("x", "y", "z"),
        log_scales=columns("scale_0", "scale_1", "scale_2"),
        quats=columns("rot_0", "rot_1", "rot_2", "rot_3"),
        logits=columns("opacity")[:, 0],
        harmonics=np.concatenate([constant, rest], axis=1),
        comments=tuple(line[8:] for line in lines if line.startswith("comment ")),
    )


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
    if rest // 3 + 1 > _DEGREE_3:
        raise InputError(f"{path} has harmonics of degree {degree}: name a PLY of degree 3 or lower.")
    return np.dtype(fields)

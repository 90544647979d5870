"""PLY files in the layout of 3DGS, which viewers read."""

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np
import torch

from imaging.arrays import Array, Floats
from imaging.files import store
from recon.data.world import SAME, Vector, WorldTransform
from recon.scene.appearance import Appearance, PlainHarmonics
from recon.scene.gaussians import Gaussians
from recon.scene.harmonics import basis, sphere


def properties(degree: int, *, normals: bool = False) -> tuple[str, ...]:
    """Names of a Gaussian's numbers, little-endian float32 each, with harmonics of a degree.

    Colour towards direction d: max(0, 0.5 + SH(d)), the harmonics as in 3DGS; f_rest holds all of red, then
    green, then blue, and viewers derive the degree from their number. opacity is a logit, scales are natural
    logarithms, rot is wxyz. The comments state whether colours are display values or light. normals: with
    those of the first 3DGS files, all zero, which Mitsuba demands, and gsplat and PlayCanvas leave out.
    """
    return (
        *("x", "y", "z"),
        *(("nx", "ny", "nz") if normals else ()),
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
    *,
    normals: bool = False,
    more: Mapping[str, Array] = MappingProxyType({}),
) -> None:
    """Write the Gaussians with the colours of `plain_harmonics`.

    Args:
        path: File.
        gaussians: N Gaussians on the CPU, in scene coordinates.
        harmonics: Coefficients of their colours, [N, (degree + 1)^2, 3].
        comments: Comments of the header in ASCII, each written on a line of its own.
        world: Transform from the scene to the world.
        offset: Offset that is subtracted from the coordinates of the world.
        normals: True to write normals of zero (see `properties`).
        more: Further properties, [N] each, by name.

    Raises:
        StorageError: The disk refuses.
    """
    count = len(gaussians)
    parameters = {name: value.detach().numpy() for name, value in gaussians.parameters.items()}
    quats = parameters["quats"] / np.linalg.norm(parameters["quats"], axis=1, keepdims=True).clip(1e-12)
    columns = [
        world.to_world(parameters["means"]) - offset,
        np.zeros((count, 3 if normals else 0)),
        harmonics[:, 0],
        harmonics[:, 1:].transpose(0, 2, 1).reshape(count, -1),
        parameters["opacity_logits"][:, None],
        parameters["log_scales"].astype(np.float64) + np.log(world.unit),
        quats,
        *(values[:, None] for values in more.values()),
    ]
    header = ["ply", "format binary_little_endian 1.0", *(f"comment {comment}" for comment in comments)]
    names = *properties(math.isqrt(harmonics.shape[1]) - 1, normals=normals), *more
    header += [f"element vertex {count}", *(f"property float {name}" for name in names), "end_header"]
    body = np.concatenate(columns, axis=1).astype("<f4").tobytes()
    store.write_bytes(path, ("\n".join(header) + "\n").encode("ascii") + body)


def most_gaussians(size: float, degree: int) -> int:
    """Maximum number of Gaussians of a degree in a file of `size` bytes, its header taken at 2000 bytes."""
    return max(0, int((size - 2000) // (4 * len(properties(degree)))))

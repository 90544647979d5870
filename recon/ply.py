"""`splats.ply` in the layout of 3DGS, which viewers read, with radiance instead of display colours."""

from pathlib import Path

import numpy as np
import numpy.typing as npt
import torch

from imaging import store
from imaging.errors import ReconstructionError
from recon.appearance import Appearance
from recon.gaussians import Gaussians
from recon.harmonics import C0, basis, sphere

Table = dict[str, npt.NDArray[np.float32]]


def properties(degree: int) -> tuple[str, ...]:
    """Names of a Gaussian's numbers, little-endian float32 each, with harmonics of a degree.

    Colour towards direction d: max(0, 0.5 + SH(d)), the harmonics as in 3DGS; f_rest holds all of red, then
    green, then blue, and viewers tell the degree by how many there are. opacity is a logit, scales are
    natural logarithms, rot is wxyz. Colours are linear Rec.709 radiance divided by the exposure named in the
    comments. The normals of the first 3DGS files, all zero, are left out, as gsplat and PlayCanvas do.
    """
    return (
        *("x", "y", "z"),
        *(f"f_dc_{channel}" for channel in range(3)),
        *(f"f_rest_{index}" for index in range(3 * ((degree + 1) ** 2 - 1))),
        "opacity",
        *(f"scale_{axis}" for axis in range(3)),
        *(f"rot_{part}" for part in range(4)),
    )


def radiance_harmonics(gaussians: Gaussians, appearance: Appearance, degree: int) -> npt.NDArray[np.float64]:
    """The appearance as a plain series of harmonics of linear radiance: float64 [N, (degree + 1)^2, 3], scene
    units.

    Least squares over directions spread evenly over the sphere: exact for a plain series, the best of
    its degree for the others.
    """
    directions = torch.from_numpy(sphere().astype(np.float32))
    inverse = np.linalg.pinv(basis(directions, degree).double().numpy())
    total = np.zeros((len(gaussians), len(inverse), 3))
    with torch.no_grad():
        for column, direction in enumerate(directions):
            towards = direction.expand(len(gaussians), 3)
            colours = appearance.colours(gaussians.parameters, towards, degree).double().numpy()
            total += inverse[:, column][None, :, None] * colours[:, None]
    return total


def write_ply(
    path: Path, gaussians: Gaussians, appearance: Appearance, degree: int, scale: float, note: str
) -> None:
    """Write the Gaussians, their harmonics up to a degree; colours are scene units times `scale`; `note`
    becomes a comment line.
    """
    harmonics = radiance_harmonics(gaussians, appearance, degree) * scale
    harmonics[:, 0] -= 0.5 / C0
    count = len(gaussians)
    parameters = {name: value.detach().numpy() for name, value in gaussians.parameters.items()}
    quats = parameters["quats"] / np.linalg.norm(parameters["quats"], axis=1, keepdims=True).clip(1e-12)
    columns = [
        parameters["means"],
        harmonics[:, 0],
        harmonics[:, 1:].transpose(0, 2, 1).reshape(count, -1),
        parameters["opacity_logits"][:, None],
        parameters["log_scales"],
        quats,
    ]
    header = ["ply", "format binary_little_endian 1.0", f"comment {note}", f"element vertex {count}"]
    header += [*(f"property float {name}" for name in properties(degree)), "end_header"]
    body = np.concatenate(columns, axis=1).astype("<f4").tobytes()
    store.write_bytes(path, ("\n".join(header) + "\n").encode("ascii") + body)


def most_gaussians(size: float, degree: int) -> int:
    """How many Gaussians of a degree fit into a file of `size` bytes, its header taken at 2000 bytes."""
    return max(0, int((size - 2000) // (4 * len(properties(degree)))))


def read_ply(path: Path) -> Table:
    """Every property of a binary little-endian PLY of float vertices, by name: float32 [N] each."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ReconstructionError(f"{path} cannot be read: reconstruct again.") from error
    head, found, body = data.partition(b"end_header\n")
    lines = head.decode("ascii", "replace").split("\n")
    counts = [line.split()[-1] for line in lines if line.startswith("element vertex ")]
    names = [line.split()[-1] for line in lines if line.startswith("property float ")]
    if (
        not found
        or "format binary_little_endian 1.0" not in lines
        or len(counts) != 1
        or not counts[0].isdigit()
    ):
        raise ReconstructionError(f"{path} is not a PLY file of Gaussians: reconstruct again.")
    if len(body) != int(counts[0]) * len(names) * 4:
        raise ReconstructionError(f"{path} is cut short: reconstruct again.")
    values = np.frombuffer(body, "<f4").reshape(-1, len(names))
    return {name: values[:, column].astype(np.float32) for column, name in enumerate(names)}

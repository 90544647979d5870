"""PLY files of Gaussians, read back."""

from pathlib import Path

import numpy as np
import numpy.typing as npt


def read_ply(path: Path) -> dict[str, npt.NDArray[np.float32]]:
    """Every property of a binary little-endian PLY of float vertices, by name: float32 [N] each."""
    head, end, body = path.read_bytes().partition(b"end_header\n")
    lines = head.decode("ascii").split("\n")
    assert end
    assert "format binary_little_endian 1.0" in lines
    (count,) = (int(line.split()[-1]) for line in lines if line.startswith("element vertex "))
    names = [line.split()[-1] for line in lines if line.startswith("property float ")]
    assert len(body) == count * len(names) * 4
    values = np.frombuffer(body, "<f4").reshape(count, len(names))
    return {name: values[:, column].astype(np.float32) for column, name in enumerate(names)}


def read_ply_mesh(path: Path) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Places and colours, float32 [N, 3] each, of the float vertices of a binary PLY that has faces too."""
    head, _, body = path.read_bytes().partition(b"end_header\n")
    lines = head.decode("ascii").split("\n")
    (count,) = (int(line.split()[-1]) for line in lines if line.startswith("element vertex "))
    assert [line.split()[-1] for line in lines if line.startswith("property float ")] == [
        *"xyz", "red", "green", "blue",
    ]  # fmt: skip
    values = np.frombuffer(body[: count * 24], "<f4").reshape(count, 6)
    return values[:, :3], values[:, 3:]

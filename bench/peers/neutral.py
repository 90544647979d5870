"""One renderer and one set of figures for the scenes of all trainers: from a PLY file in 3DGS's layout."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
import torch

from imaging import metrics
from imaging.arrays import Array
from recon.data.dataset import View
from recon.data.world import WorldTransform
from recon.splat import Limits, SplatCamera, rasterize

_DEGREES = {1: 0, 4: 1, 9: 2, 16: 3}


@dataclass(frozen=True)
class PlySplats:
    """Gaussians of a file: tensors of N rows; harmonics [N, (degree + 1)^2, 3]."""

    means: torch.Tensor
    quats: torch.Tensor
    scales: torch.Tensor
    opacities: torch.Tensor
    harmonics: torch.Tensor

    @classmethod
    def read(cls, path: Path) -> Self:
        """A binary little-endian file whose numbers are all float32, as every trainer here writes it."""
        data = path.read_bytes()
        head, _, body = data.partition(b"end_header\n")
        lines = head.decode("ascii").splitlines()
        if "format binary_little_endian 1.0" not in lines:
            raise ValueError(f"{path} is no binary little-endian PLY")
        names = [line.split()[2] for line in lines if line.startswith("property float ")]
        count = next(int(line.split()[2]) for line in lines if line.startswith("element vertex "))
        table = np.frombuffer(body, "<f4", count * len(names)).reshape(count, len(names))
        column = {name: table[:, place] for place, name in enumerate(names)}

        def columns(wanted: list[str]) -> torch.Tensor:
            return torch.from_numpy(np.stack([column[name] for name in wanted], 1).astype(np.float32))

        rest = sum(name.startswith("f_rest_") for name in names)
        constant = columns([f"f_dc_{channel}" for channel in range(3)])[:, None]
        others = columns([f"f_rest_{place}" for place in range(rest)]) if rest else constant[:, :0].flatten(1)
        return cls(
            columns(["x", "y", "z"]),
            columns([f"rot_{part}" for part in range(4)]),
            columns([f"scale_{axis}" for axis in range(3)]).exp(),
            torch.sigmoid(columns(["opacity"])[:, 0]),
            torch.cat([constant, others.reshape(count, 3, rest // 3).transpose(1, 2)], 1),
        )

    def __len__(self) -> int:
        return len(self.means)

    def drawn(self, camera: SplatCamera, background: tuple[float, float, float]) -> Array:
        """Display values [H, W, 3] that a camera in the file's coordinates sees, at the cut-offs of 3DGS."""
        motion = camera.cam_from_world
        centre = torch.from_numpy((-motion[:3, :3].T @ motion[:3, 3]).astype(np.float32))
        away = self.means - centre
        values = basis(away / away.norm(dim=1, keepdim=True).clamp_min(1e-12))
        count = self.harmonics.shape[1]
        assert count in _DEGREES
        colours = torch.einsum("nk,nkc->nc", values[:, :count], self.harmonics) + 0.5
        with torch.no_grad():
            render = rasterize(
                self.means,
                self.quats,
                self.scales,
                self.opacities,
                colours.clamp_min(0),
                camera,
                torch.tensor(background),
                Limits.gsplat(),
            )
        return render.image.double().numpy()


def basis(directions: torch.Tensor) -> torch.Tensor:
    """Real spherical harmonics up to degree 3 at unit directions [N, 3], as 3DGS has them: [N, 16]."""
    x, y, z = directions.unbind(-1)
    xx, yy, zz = x * x, y * y, z * z
    return torch.stack(
        [
            torch.full_like(x, 0.28209479177387814),
            -0.4886025119029199 * y,
            0.4886025119029199 * z,
            -0.4886025119029199 * x,
            1.0925484305920792 * x * y,
            -1.0925484305920792 * y * z,
            0.31539156525252005 * (2 * zz - xx - yy),
            -1.0925484305920792 * x * z,
            0.5462742152960396 * (xx - yy),
            -0.5900435899266435 * y * (3 * xx - yy),
            2.890611442640554 * x * y * z,
            -0.4570457994644658 * y * (4 * zz - xx - yy),
            0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy),
            -0.4570457994644658 * x * (4 * zz - xx - yy),
            1.445305721320277 * z * (xx - yy),
            -0.5900435899266435 * x * (xx - 3 * yy),
        ],
        -1,
    )


@dataclass(frozen=True)
class Figures:
    """Means over the held-out views: dB and SSIM of display values in 0..1.

    gained: dB once each render has the one factor a channel that brings it nearest to its photograph, for
    photographs that their camera exposed one by one.
    """

    psnr: float
    gained: float
    ssim: float


def measured(views: list[View], pictures: list[Array], draw: Callable[[View], Array]) -> Figures:
    """The figures of a trainer: `draw` is asked for each of `views`, whose photographs are `pictures`."""
    rows = []
    for view, true in zip(views, pictures, strict=True):
        visible, image = view.valid, draw(view)
        shown = image.clip(0, 1)
        factors = (image * true)[visible].sum(0) / np.maximum((image * image)[visible].sum(0), 1e-12)
        gained = (image * factors).clip(0, 1)
        rows.append(
            (
                metrics.psnr(shown[visible], true[visible]),
                metrics.psnr(gained[visible], true[visible]),
                metrics.ssim(shown, true),
            )
        )
    return Figures(*np.mean(np.array(rows, np.float64), axis=0).tolist())


def in_world(view: View, world: WorldTransform) -> SplatCamera:
    """The camera of a view where files have it: in the world of the calibration."""
    return world.camera_in_world(view.lens)

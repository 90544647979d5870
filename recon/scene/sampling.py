"""Gaussians at distances and widths that they were not trained at: what of their footprint is theirs.

A Gaussian is fitted together with the blur that the rasteriser adds to it (`Limits.blur`), which is a part
of its look. Drawn twice as large it takes twice that blur with it, else it would be too thin; drawn half as
large it keeps half of it, and what a pixel blurs beyond that only spreads its light, so its opacity falls by
the root of the ratio of determinants, else it would be too thick. The latter is the 2D filter of
Mip-Splatting (Yu et al., arXiv 2311.16493), but from what was trained instead of an infinitely fine image:
within the distances of the training views nothing changes (`bench/recon/parts/scales.py`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from recon.scene.sampling_kernel import drawn_by_kernel
from recon.scene.spacing_kernel import spacing_range
from recon.splat import SplatCamera

_ROUNDING = 1e-4
"""Tolerance by which the range is wider, so that the ends of training's range are drawn as trained, to the
last bit.
"""


@dataclass(frozen=True)
class Sampling:
    """Range of distances of neighbouring pixels at which each Gaussian was trained.

    least, most: float32 [N], in the unit of the means, of the views that see it.
    """

    least: Tensor
    most: Tensor

    @classmethod
    def of(cls, means: Tensor, cameras: Sequence[SplatCamera]) -> "Sampling":
        """Measure the range of Gaussians at `means` [N, 3] over the training views; of unseen ones, 0 and
        infinity.
        """
        least, most = spacing_range(means.detach().cpu().numpy(), cameras)
        nearest, farthest = (torch.from_numpy(spacing).to(means.device) for spacing in (least, most))
        return cls(nearest * (1 - _ROUNDING), farthest * (1 + _ROUNDING))

    def drawn(
        self, away: Tensor, scales: Tensor, quats: Tensor, opacities: Tensor, camera: SplatCamera, blur: float
    ) -> tuple[Tensor, Tensor]:
        """Scales [N, 3] and opacities [N] with which `rasterize` draws them as they were trained.

        away: [N, 3] from the camera to them, in world axes.
        """
        given = (away, scales, quats, opacities, self.least, self.most)
        if not torch.is_grad_enabled() and all(_plain(tensor) for tensor in given):
            arrays = [tensor.contiguous().numpy() for tensor in given]
            wide, thick = drawn_by_kernel(arrays, camera, blur)
            return torch.from_numpy(wide), torch.from_numpy(thick)
        spacing = spacing_of(away, camera)
        finer = (self.least.to(spacing.device) / spacing).clamp_min(1.0)
        coarser = (self.most.to(spacing.device) / spacing).clamp_max(1.0)
        near, far = (finer > 1).nonzero()[:, 0], (coarser < 1).nonzero()[:, 0]
        if len(near):
            added = blur * (finer[near] ** 2 - 1) * spacing[near] ** 2
            near_scales = scales[near]  # one of zero, which is never drawn, stays so
            scales = scales.index_put(
                (near,), torch.where(near_scales > 0, (near_scales**2 + added[:, None]).sqrt(), near_scales)
            )
        if len(far):
            theirs = blur * coarser[far] ** 2
            ray = torch.nn.functional.normalize(away[far], dim=1)
            variances = (scales[far] / spacing[far, None]).square()
            share = _compensation(ray, variances, quats[far], theirs, blur)
            opacities = opacities.index_put((far,), opacities[far] * share)
        return scales, opacities


def _plain(tensor: Tensor) -> bool:
    """Return whether Numba may read it."""
    return tensor.device.type == "cpu" and tensor.dtype == torch.float32


def away_from(means: Tensor, camera: SplatCamera) -> Tensor:
    """[N, 3] from the camera to points, in world axes."""
    motion = camera.cam_from_world
    centre = torch.from_numpy((-motion[:3, :3].T @ motion[:3, 3]).astype(np.float32))
    return means - centre.to(means, non_blocking=True)


def spacing_of(away: Tensor, camera: SplatCamera) -> Tensor:
    """[N] from one pixel to the next where Gaussians are, in their unit, by the area that a pixel has there.

    That is the square of distance over focal length on the axis, and off it smaller, as a lens without
    distortion or an equidistant fisheye spreads a solid angle. Of what is behind the camera it means nothing.
    """
    distance = away.norm(dim=1).clamp_min(1e-12)
    axis = torch.from_numpy(np.asarray(camera.cam_from_world[2, :3], np.float32)).to(away)
    cosine = (away @ axis / distance).clamp(0.02, 1.0)
    if camera.fisheye:
        shrunk = torch.sinc(torch.acos(cosine) / torch.pi).sqrt()
    else:
        shrunk = cosine * cosine.sqrt()
    spacing: Tensor = shrunk * distance / float(np.sqrt(camera.fx * camera.fy))
    return spacing


def footprint(away: Tensor, scales: Tensor, quats: Tensor, camera: SplatCamera, blur: float) -> Tensor:
    """The integral of each Gaussian over the picture plane, px^2, its peak being 1: [N].

    Args:
        away: Vectors [N, 3] from the camera to the Gaussians, in world axes.
        scales: Standard deviations [N, 3] along the own axes, in the unit of `away`.
        quats: Rotations [N, 4], wxyz, of any length but 0.
        camera: Camera that sees them.
        blur: Variance that the rasteriser adds, px^2.

    Returns:
        The integrals.
    """
    spacing = spacing_of(away, camera)
    ray = torch.nn.functional.normalize(away, dim=1)
    sharp, wide = _determinants(ray, (scales / spacing[:, None]).square(), quats)
    area: Tensor = 2 * torch.pi * (sharp + blur * (wide + blur)).sqrt()
    return area


def _compensation(ray: Tensor, variances: Tensor, quats: Tensor, theirs: Tensor, blur: float) -> Tensor:
    """[M] root of the ratio of determinants of covariances across a ray with `theirs` and with `blur`, px^2.

    ray [M, 3] has length 1, variances [M, 3] are along the own axes, px^2. What a lens does to a small
    Gaussian is in both determinants.
    """
    sharp, wide = _determinants(ray, variances, quats)
    share: Tensor = ((sharp + theirs * (wide + theirs)) / (sharp + blur * (wide + blur))).sqrt()
    return share


def _determinants(ray: Tensor, variances: Tensor, quats: Tensor) -> tuple[Tensor, Tensor]:
    """Determinant and trace [M] of covariances across a ray; arguments as of `_compensation`."""
    quats = quats / quats.abs().amax(dim=1, keepdim=True)
    w, turn = (quats / quats.norm(dim=1, keepdim=True)).split((1, 3), dim=1)
    twice = 2 * torch.linalg.cross(turn, ray)
    along = (ray - w * twice + torch.linalg.cross(turn, twice)).square()  # of the ray in the own axes
    first, second, third = variances.unbind(1)
    a, b, c = along.unbind(1)
    sharp: Tensor = second * third * a + third * first * b + first * second * c
    wide: Tensor = (variances * (1 - along).clamp_min(0)).sum(1)
    return sharp, wide

"""Differentiable rendering of 3D Gaussians, right at high contrast, without a GPU or a compiler.

`rasterize` is the one entry: float32 tensors on the CPU go to Numba kernels, float64 ones to a dense
reference. 3D Gaussian Splatting: Kerbl et al. 2023, arXiv 2308.04079; EWA splatting: Zwicker et al. 2001.
"""

import torch

from recon.splat.camera import SplatCamera
from recon.splat.cpu import rasterize_cpu
from recon.splat.limits import Limits
from recon.splat.moved import DELTA, moved
from recon.splat.reference import rasterize_reference
from recon.splat.render import Render, SplatStats

__all__ = ["Limits", "Render", "SplatCamera", "SplatStats", "rasterize"]

_DEFAULT = Limits()


def rasterize(
    means: torch.Tensor,
    quats: torch.Tensor,
    scales: torch.Tensor,
    opacities: torch.Tensor,
    colours: torch.Tensor,
    camera: SplatCamera,
    background: torch.Tensor | None = None,
    limits: Limits = _DEFAULT,
    stats: SplatStats | None = None,
    camera_delta: torch.Tensor | None = None,
) -> Render:
    """Render Gaussians; differentiable in every tensor.

    means: [N, 3] world units. quats: [N, 4] wxyz, normalised inside. scales: [N, 3] standard
    deviations, world units, positive. opacities: [N] in 0..1. colours: [N, 3] linear. background: [3]
    or None for black. All of one dtype: float32 (fast) or float64 (the dense reference: small scenes).
    Bad Gaussians (values not finite, scales not positive, zero quaternions, negative opacity, colours
    beyond 1e30) are not drawn, get zero gradients and are counted in `Render.culled`.

    camera_delta: [14], float32 or float64, for pose and lens refinement: how far the camera is moved, in
    the units and the order of `recon.splat.moved.moved`; zeros are the camera as it is. The gradient is
    that of the projection; the cut-offs that depend on the lens follow it without one.
    """
    _check(means, quats, scales, opacities, colours, background, stats)
    view = None
    if camera_delta is not None:
        if tuple(camera_delta.shape) != (DELTA,):
            raise ValueError(f"camera_delta has shape {tuple(camera_delta.shape)}, not {(DELTA,)}")
        camera, view = moved(camera, camera_delta)
    rasterizer = rasterize_reference if means.dtype == torch.float64 else rasterize_cpu
    return rasterizer(means, quats, scales, opacities, colours, camera, background, limits, stats, view)


def _check(
    means: torch.Tensor,
    quats: torch.Tensor,
    scales: torch.Tensor,
    opacities: torch.Tensor,
    colours: torch.Tensor,
    background: torch.Tensor | None,
    stats: SplatStats | None,
) -> None:
    """Shapes, dtypes and devices; ValueError names the one that does not fit."""
    n = len(means)
    shapes = {"means": (n, 3), "quats": (n, 4), "scales": (n, 3), "opacities": (n,), "colours": (n, 3)}
    tensors = {"means": means, "quats": quats, "scales": scales, "opacities": opacities, "colours": colours}
    if background is not None:
        shapes["background"], tensors["background"] = (3,), background
    for name, tensor in tensors.items():
        if tuple(tensor.shape) != shapes[name]:
            raise ValueError(f"{name} has shape {tuple(tensor.shape)}, not {shapes[name]}")
        if tensor.device.type != "cpu":
            raise ValueError(f"{name} is on {tensor.device}: move it to the CPU")
        if tensor.dtype != means.dtype or tensor.dtype not in (torch.float32, torch.float64):
            raise ValueError(f"{name} is {tensor.dtype}: all tensors must be float32, or all float64")
    if background is not None and not torch.isfinite(background).all():
        raise ValueError("background is not finite")
    if stats is not None and stats.count != n:
        raise ValueError(f"stats counts {stats.count} Gaussians, but there are {n}")

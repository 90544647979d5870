"""Differentiable rendering of 3D Gaussians, right at high contrast, without a GPU or a compiler.

`rasterize` is the one entry: float32 tensors on the CPU go to Numba kernels, those on a CUDA GPU to Triton
kernels, float64 ones to a dense reference. 3D Gaussian Splatting: Kerbl et al. 2023, arXiv 2308.04079;
EWA splatting: Zwicker et al. 2001.
"""

from collections.abc import Callable

import torch

from imaging.errors import InputError, ReconstructionError
from recon.splat.camera import SplatCamera
from recon.splat.corrected_camera import DELTA, moved
from recon.splat.cpu.rasterizer import rasterize_cpu
from recon.splat.limits import CHANNELS_MOST, Limits
from recon.splat.raster_types import RasterInputs, Render, SplatStats
from recon.splat.reference import rasterize_reference

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

    All tensors are on one device and of one dtype: float32 (fast, on the CPU or a CUDA GPU) or float64 (the
    dense reference on the CPU: small scenes). Bad Gaussians (values not finite, scales not positive, zero
    quaternions, negative opacity, colours beyond 1e30) are not drawn, get zero gradients and are counted in
    `Render.culled`.

    Args:
        means: [N, 3] world units.
        quats: [N, 4] wxyz, normalised inside.
        scales: [N, 3] standard deviations, world units, positive.
        opacities: [N] in 0..1.
        colours: [N, C] linear, of 1 to 16 channels.
        camera: View to draw.
        background: [C]; None: black.
        limits: Cut-offs of near Gaussians, footprints and opacities.
        stats: Counts for density control, which the render adds to; None: not counted.
        camera_delta: [14], float32 or float64, for pose and lens refinement: the movement of the camera, in
            the units and the order of `recon.splat.corrected_camera.moved`; zeros are the camera as it is.
            The gradient is that of the projection; the cut-offs that depend on the lens follow without one.

    Returns:
        Image [H, W, C], alpha [H, W] and the depth that was requested.

    Raises:
        InputError: Shapes, dtypes or devices do not agree.
    """
    _check(means, quats, scales, opacities, colours, camera, background, stats)
    view = None
    if camera_delta is not None:
        if tuple(camera_delta.shape) != (DELTA,):
            raise InputError(f"camera_delta has shape {tuple(camera_delta.shape)}, not {(DELTA,)}")
        camera, view = moved(camera, camera_delta)
    rasterizer = _rasterizer(means.device.type, means.dtype)
    return rasterizer(
        RasterInputs(means, quats, scales, opacities, colours, camera, background, limits, stats, view)
    )


def _rasterizer(device: str, dtype: torch.dtype) -> Callable[[RasterInputs], Render]:
    """The execution for a type of device; ReconstructionError for CUDA without Triton."""
    if dtype == torch.float64:
        return rasterize_reference
    if device == "cpu":
        return rasterize_cpu
    try:
        from recon.splat.gpu import rasterize_gpu  # here, so that who has no GPU needs no Triton
    except ImportError as error:
        if error.name != "triton":
            raise
        raise ReconstructionError(
            "rendering on the GPU needs Triton 3.4 or newer: install torch 2.8 or newer, built for CUDA (on "
            "Linux it brings Triton), or move the tensors to the CPU"
        ) from error
    return rasterize_gpu


def _check(
    means: torch.Tensor,
    quats: torch.Tensor,
    scales: torch.Tensor,
    opacities: torch.Tensor,
    colours: torch.Tensor,
    camera: SplatCamera,
    background: torch.Tensor | None,
    stats: SplatStats | None,
) -> None:
    """Shapes, dtypes and devices; InputError names the one that does not fit.

    InputError for what is no tensor.
    """
    given: dict[str, tuple[object, type]] = {
        "means": (means, torch.Tensor),
        "quats": (quats, torch.Tensor),
        "scales": (scales, torch.Tensor),
        "opacities": (opacities, torch.Tensor),
        "colours": (colours, torch.Tensor),
        "camera": (camera, SplatCamera),
    }
    if background is not None:
        given["background"] = background, torch.Tensor
    for name, (value, kind) in given.items():
        if not isinstance(value, kind):
            raise InputError(f"{name} is a {type(value).__name__}: give it as a {kind.__name__}.")
    if not means.ndim:
        raise InputError("means has shape (), not (N, 3)")
    n = len(means)
    channels = colours.shape[1] if colours.ndim == 2 else 0
    if not 1 <= channels <= CHANNELS_MOST:
        raise InputError(
            f"colours has shape {tuple(colours.shape)}, not (N, C) with 1 to {CHANNELS_MOST} channels"
        )
    shapes = {"means": (n, 3), "quats": (n, 4), "scales": (n, 3), "opacities": (n,), "colours": (n, channels)}
    tensors = {"means": means, "quats": quats, "scales": scales, "opacities": opacities, "colours": colours}
    if background is not None:
        shapes["background"], tensors["background"] = (channels,), background
    for name, tensor in tensors.items():
        if tuple(tensor.shape) != shapes[name]:
            raise InputError(f"{name} has shape {tuple(tensor.shape)}, not {shapes[name]}")
        if tensor.device != means.device:
            raise InputError(
                f"{name} is on {tensor.device} and means on {means.device}: move them to one device"
            )
        if tensor.dtype != means.dtype or tensor.dtype not in (torch.float32, torch.float64):
            raise InputError(f"{name} is {tensor.dtype}: all tensors must be float32, or all float64")
    if means.device.type not in ("cpu", "cuda"):
        raise InputError(f"the tensors are on {means.device}: move them to the CPU or to a CUDA GPU")
    if means.device.type == "cuda" and means.dtype == torch.float64:
        raise InputError(
            f"the float64 reference runs on the CPU, and the tensors are on {means.device}: move them"
        )
    if background is not None and not torch.isfinite(background).all():
        raise InputError("background is not finite")
    if stats is not None and stats.count != n:
        raise InputError(f"stats counts {stats.count} Gaussians, but there are {n}")
    if stats is not None and stats.weight.device != means.device:
        raise InputError(f"stats is on {stats.weight.device} and means on {means.device}: make it there")

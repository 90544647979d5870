"""Compile every kernel before the work begins, so that the wait has a name."""

import numpy as np
import torch

from imaging.compute.jit import cache_folder
from imaging.progress import Progress
from recon.observe.kernels.display_kernel import photographed
from recon.observe.kernels.linear_kernel import Sites, recorded
from recon.observe.losses.ssim import photometric_loss
from recon.splat import Limits, SplatCamera, SplatStats, rasterize
from recon.splat.limits import CHANNELS_MOST
from recon.train.devices.gpu_check import checked

_CPU = torch.device("cpu")


def warm_up(
    progress: Progress,
    device: torch.device = _CPU,
    *,
    fisheye: bool = False,
    channels: int = 3,
    depth: bool = False,
) -> None:
    """Run each kernel once, on next to nothing: those of the CPU, then those of a GPU that are right there.

    The first time on a machine this compiles for some ten to twenty seconds; the result is kept on disk
    (see `imaging.compute.jit`; Triton has a cache of its own) and loaded in a fraction of a second
    afterwards. A GPU's kernels are compared with the CPU's then (`recon.train.devices.gpu_check`).

    Args:
        progress: Callback for the current step, the steps done, and all of them.
        device: Device of the training.
        fisheye: True to run also the kernels that project through fisheyes, which are compiled apart.
        channels: Channels of the light, for which the blending is compiled.
        depth: True to run also the kernels that draw depth beside the light.
    """
    cached = any(cache_folder().rglob("*.nbi"))
    doing = "loading" if cached else "compiling, once on this machine,"
    total = 3 if device == _CPU else 4
    progress(f"{doing} the rasteriser", 0, total)
    image = _render(_CPU, channels=channels)
    progress(f"{doing} its gradient", 1, total)
    image.sum().backward()  # type: ignore[no-untyped-call]
    if fisheye:
        _render(_CPU, fisheye=True, channels=channels).sum().backward()  # type: ignore[no-untyped-call]
    if depth and channels < CHANNELS_MOST:
        _render(_CPU, channels=channels + 1).sum().backward()  # type: ignore[no-untyped-call]
    progress(f"{doing} cameras and SSIM", 2, total)
    _observe(image.detach()[:, :, :1].expand(-1, -1, 3))
    planes = image.detach().permute(2, 0, 1).contiguous()
    photometric_loss(planes.requires_grad_(), torch.zeros_like(planes), 0.5)
    if device != _CPU:
        progress("loading the kernels of the GPU, or compiling and checking them once", 3, total)
        if not checked(device).wrong:
            _render(device, fisheye=fisheye).sum().backward()  # type: ignore[no-untyped-call]
    progress("kernels are ready", total, total)


def _observe(image: torch.Tensor) -> None:
    """Observe an image [H, W, 3] as shots of linear light and as photographs."""
    image = image.contiguous().requires_grad_()
    planes = torch.zeros(3, *image.shape[:2])
    sites = Sites((1, 1), np.zeros((3, 2), np.int64), np.eye(3, dtype=np.float32))
    recorded(image, torch.ones(1), sites, planes, planes[None], None, None, 1.0).sum().backward()  # type: ignore[no-untyped-call]
    gains, shade = np.ones((1, 3), np.float32), np.empty((0, 0), np.float32)
    photographed(image, shade, gains, planes.to(torch.uint8), None, None)[0].sum().backward()  # type: ignore[no-untyped-call]


def _render(device: torch.device, *, fisheye: bool = False, channels: int = 3) -> torch.Tensor:
    """One Gaussian on 16x16 pixels."""
    camera = SplatCamera(np.eye(4), fx=20.0, fy=20.0, cx=8.0, cy=8.0, width=16, height=16, fisheye=fisheye)
    means = torch.tensor([[0.0, 0.0, 2.0]], requires_grad=True)
    quats, scales = torch.tensor([[1.0, 0.0, 0.0, 0.0]]), torch.full((1, 3), 0.1)
    means, quats, scales = means.to(device), quats.to(device), scales.to(device)
    opacities, colours = torch.tensor([0.5], device=device), torch.ones(1, channels, device=device)
    stats = SplatStats(1, device)
    return rasterize(means, quats, scales, opacities, colours, camera, None, Limits(), stats).image

"""Compile every kernel before the work begins, so that the wait has a name."""

from collections.abc import Callable

import numpy as np
import torch

from recon.jit import cache_folder
from recon.splat import Limits, SplatCamera, SplatStats, rasterize
from recon.ssim import photometric_loss

Progress = Callable[[str, int, int], None]


def warm_up(progress: Progress) -> None:
    """Run each kernel once, on next to nothing.

    The first time on a machine this compiles for some ten to twenty seconds; the result is kept on disk
    (see `recon.jit`) and loaded in a fraction of a second afterwards. progress: (message, done, total).
    """
    kept = any(cache_folder().rglob("*.nbi"))
    doing = "loading" if kept else "compiling, once on this machine,"
    camera = SplatCamera(np.eye(4), fx=20.0, fy=20.0, cx=8.0, cy=8.0, width=16, height=16)
    means = torch.tensor([[0.0, 0.0, 2.0]], requires_grad=True)
    quats, scales = torch.tensor([[1.0, 0.0, 0.0, 0.0]]), torch.full((1, 3), 0.1)
    opacities, colours = torch.tensor([0.5]), torch.ones(1, 3)
    progress(f"{doing} the rasteriser", 0, 3)
    image = rasterize(means, quats, scales, opacities, colours, camera, None, Limits(), SplatStats(1)).image
    progress(f"{doing} its gradient", 1, 3)
    image.sum().backward()  # type: ignore[no-untyped-call]
    progress(f"{doing} SSIM", 2, 3)
    planes = image.detach().permute(2, 0, 1).contiguous()
    photometric_loss(planes.requires_grad_(), torch.zeros_like(planes), 0.5)
    progress("kernels are ready", 3, 3)

"""The Gaussians of a workload, drawn: what the tables of the rasteriser time."""

from collections.abc import Sequence

import torch

from recon.splat import Limits, Render, SplatCamera, rasterize


def drawn(tensors: Sequence[torch.Tensor], camera: SplatCamera, limits: Limits) -> Render:
    """Draw by our rasteriser; tensors: means, quats, scales, opacities, colours, as `workload` has them."""
    means, quats, scales, opacities, colours = tensors
    return rasterize(means, quats, scales, opacities, colours, camera, limits=limits)

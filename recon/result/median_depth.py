"""The depth at which half of the light from behind is stopped, by drawing slab after slab, nearest first.

Blending is in order of depth, so what slabs of it let through multiplies: each Gaussian is drawn once, and
the first slab at which less than half is left holds the surface.
"""

import numpy as np
import torch

from imaging.arrays import Array32
from recon.scene.gaussians import Shapes, drawn_values
from recon.splat import Limits, SplatCamera
from recon.splat.torch_threads import torch_on_one_thread

SLABS = 32
FEWEST = 128
"""Gaussians of a slab, at least."""
HALF = 0.5


def median_depth(shapes: Shapes, camera: SplatCamera, limits: Limits) -> Array32:
    """Depth along the axis, float32 [H, W], in the unit of the means; infinite where half is never stopped.

    It is the mean of those Gaussians of the slab that are at the pixel, by what they add to it.
    """
    motion = torch.from_numpy(camera.cam_from_world).to(shapes.means)
    depth = shapes.means @ motion[2, :3] + motion[2, 3]
    order = torch.argsort(depth, stable=True)
    order = order[(depth[order] >= limits.near) & torch.isfinite(depth[order])]
    transmittance = np.ones((camera.height, camera.width), np.float32)
    median = np.full_like(transmittance, np.inf)
    size = max(FEWEST, -(-len(order) // SLABS))
    for first in range(0, len(order), size):
        rows = order[first : first + size]
        with torch.no_grad(), torch_on_one_thread():
            render = drawn_values(shapes.rows(rows), depth[rows, None], camera, limits)
        alpha, sums = render.alpha.numpy(), render.image[..., 0].numpy()
        open_before = transmittance > HALF
        transmittance *= 1 - alpha
        here = open_before & (transmittance <= HALF)
        median[here] = sums[here] / alpha[here]
        if not (transmittance > HALF).any():
            break
    return median

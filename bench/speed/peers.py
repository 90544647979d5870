"""Reference implementation of the rasteriser's speed: the same algorithm in plain torch, tile after tile.

Projection is one batch; each 16x16 tile is then a handful of matrix operations over its list of Gaussians;
autograd does the backward pass. gsplat's rules (alpha at most 0.999 and at least 1/255, transmittance at
least 1e-4). The lists of the tiles are given, made by our kernels outside the timing: that favours this peer.
"""

import numpy as np
import torch

from recon.splat import Limits, SplatCamera
from recon.splat.cpu.rasterizer import Lease, _Tables
from recon.splat.cpu.tiles import ID_BITS
from recon.splat.raster_types import RenderCall

TILE = 16


def tile_lists(tensors: list[torch.Tensor], camera: SplatCamera) -> list[torch.Tensor]:
    """The Gaussians of each tile, nearest first, by the exact test of ellipse against tile."""
    call = RenderCall(camera, Limits.gsplat(), None, keep=False)
    lists = _Tables(Lease(), [tensor.detach().numpy() for tensor in tensors], call).lists
    ids = torch.from_numpy((lists.id & ((1 << ID_BITS) - 1)).astype(np.int64))
    return list(torch.split(ids, np.diff(lists.start).tolist()))


def torch_tiles(tensors: list[torch.Tensor], camera: SplatCamera, lists: list[torch.Tensor]) -> torch.Tensor:
    """Image [H, W, 3], differentiable; a pinhole camera without distortion, a black background."""
    means, quats, scales, opacities, colours = tensors
    mean2d, conic = _project(means, quats, scales, camera)
    across, down = -(-camera.width // TILE), -(-camera.height // TILE)
    place = torch.arange(TILE) + 0.5
    inside = torch.stack(torch.meshgrid(place, place, indexing="xy"), dim=-1).reshape(-1, 1, 2)
    tiles = []
    for number, ids in enumerate(lists):
        corner = torch.tensor([number % across * TILE, number // across * TILE])
        offset = inside + corner - mean2d[ids]  # [256, K, 2]
        dx, dy = offset.unbind(-1)
        a, b, c = conic[ids].unbind(-1)
        alpha = opacities[ids] * torch.exp(-0.5 * (a * dx * dx + c * dy * dy) - b * dx * dy)
        alpha = torch.where(alpha >= 1 / 255, alpha.clamp(max=0.999), 0.0)
        light = torch.cumprod(1 - alpha, dim=1)
        before = torch.cat([torch.ones_like(light[:, :1]), light[:, :-1]], dim=1)
        weight = torch.where(before >= 1e-4, alpha * before, 0.0)
        tiles.append(weight @ colours[ids])
    image = torch.stack(tiles).reshape(down, across, TILE, TILE, 3).transpose(1, 2)
    return image.reshape(down * TILE, across * TILE, 3)[: camera.height, : camera.width]


def _project(
    means: torch.Tensor, quats: torch.Tensor, scales: torch.Tensor, camera: SplatCamera
) -> tuple[torch.Tensor, torch.Tensor]:
    motion = torch.from_numpy(camera.cam_from_world).float()
    x, y, z = (means @ motion[:3, :3].T + motion[:3, 3]).unbind(-1)
    u_min, u_max, v_min, v_max = camera.tangent_bounds(0.3)
    u, v, none = (x / z).clamp(u_min, u_max), (y / z).clamp(v_min, v_max), torch.zeros_like(z)
    row0 = torch.stack([camera.fx / z, none, -camera.fx * u / z], dim=-1)
    row1 = torch.stack([none, camera.fy / z, -camera.fy * v / z], dim=-1)
    w, i, j, k = torch.nn.functional.normalize(quats, dim=-1).unbind(-1)
    rotation = torch.stack(
        [
            1 - 2 * (j * j + k * k), 2 * (i * j - w * k), 2 * (i * k + w * j),
            2 * (i * j + w * k), 1 - 2 * (i * i + k * k), 2 * (j * k - w * i),
            2 * (i * k - w * j), 2 * (j * k + w * i), 1 - 2 * (i * i + j * j),
        ],
        dim=-1,
    ).reshape(-1, 3, 3)  # fmt: skip
    root = torch.stack([row0, row1], dim=1) @ motion[:3, :3] @ (rotation * scales[:, None])
    a = (root[:, 0] ** 2).sum(-1) + 0.3
    b = (root[:, 0] * root[:, 1]).sum(-1)
    c = (root[:, 1] ** 2).sum(-1) + 0.3
    conic = torch.stack([c, -b, a], dim=-1) / (a * c - b * b)[:, None]
    mean2d = torch.stack([camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy], dim=-1)
    return mean2d, conic

"""The rasteriser on the CPU: the Numba kernels in order, as one differentiable torch operation."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from recon.jit import running, thread_count
from recon.splat import tiles
from recon.splat.buffers import Array, Lease
from recon.splat.camera import SplatCamera
from recon.splat.composite import CHUNK, PIXELS, composite
from recon.splat.composite_backward import SLOT, composite_backward
from recon.splat.limits import Limits
from recon.splat.project import BAD, parameters, project
from recon.splat.project_backward import project_backward
from recon.splat.render import Render, SplatStats

_T_LEAST = 1e-30
"""Smallest stopping transmittance in float32: below it products would lose digits to denormals."""


@dataclass
class _Call:
    """What a render needs besides its tensors, and what it finds out."""

    camera: SplatCamera
    limits: Limits
    stats: SplatStats | None
    keep: bool
    culled: int = 0
    visible: int = 0
    pairs: int = 0


def rasterize_cpu(
    means: torch.Tensor,
    quats: torch.Tensor,
    scales: torch.Tensor,
    opacities: torch.Tensor,
    colours: torch.Tensor,
    camera: SplatCamera,
    background: torch.Tensor | None,
    limits: Limits,
    stats: SplatStats | None,
) -> Render:
    """As `rasterize`, for float32 tensors on the CPU. ValueError for more than 2^28 Gaussians."""
    if len(means) >= tiles.MAX_GAUSSIANS:
        raise ValueError(f"{len(means)} Gaussians are more than {tiles.MAX_GAUSSIANS - 1}")
    back = torch.zeros(3) if background is None else background
    tensors = (means, quats, scales, opacities, colours, back)
    keep = torch.is_grad_enabled() and any(tensor.requires_grad for tensor in tensors)
    call = _Call(camera, limits, stats, keep)
    image, left = _Rasterize.apply(*tensors, call)  # type: ignore[no-untyped-call]
    return Render(image, 1 - left, call.culled, call.visible, call.pairs)


def _numpy(tensor: torch.Tensor) -> Array:
    """The tensor's memory as a contiguous array."""
    array: Array = tensor.detach().contiguous().numpy()
    return array


class _Rasterize(torch.autograd.Function):
    """means, quats, scales, opacities, colours, background -> image [H, W, 3], transmittance [H, W]."""

    @staticmethod
    def forward(ctx: Any, *arguments: Any) -> tuple[torch.Tensor, torch.Tensor]:
        *tensors, call = arguments
        arrays = [_numpy(tensor) for tensor in tensors]
        lease = Lease()
        tables = _bin(arrays, call, lease)
        image, left = _blend(arrays[5], call, lease, tables)
        if call.keep:
            ctx.save_for_backward(*tensors, left)
            ctx.call, ctx.lease, ctx.tables = call, lease, tables
            ctx.set_materialize_grads(False)
        return image, left

    @staticmethod
    def backward(ctx: Any, *gradients: torch.Tensor | None) -> tuple[torch.Tensor | None, ...]:
        *tensors, left = ctx.saved_tensors
        height, width = left.shape
        image, light = gradients
        if image is None:
            image = torch.zeros(height, width, 3)
        if light is None:
            light = torch.zeros(height, width)
        arrays = [_numpy(tensor) for tensor in tensors]
        found = _gradients(arrays, ctx.call, ctx.lease, ctx.tables, _numpy(image), _numpy(light))
        back = None
        if ctx.needs_input_grad[5]:
            sums = np.einsum("hw,hwc->c", left.numpy(), _numpy(image), dtype=np.float64)
            back = torch.from_numpy(sums.astype(np.float32))
        return (*found, back, None)


def _bin(arrays: list[Array], call: _Call, lease: Lease) -> dict[str, Array]:
    """Project all Gaussians and list them by tile; the tables of `project`, `emit` and `scatter`."""
    n, width, height = len(arrays[0]), call.camera.width, call.camera.height
    across, down = -(-width // tiles.TILE), -(-height // tiles.TILE)
    get = lease.buffers.array
    t = {
        "k": parameters(call.camera, call.limits),
        "shape": get("shape", (n, 8), np.float64),
        "paint": get("paint", (n, 8), np.float32),
        "box": get("box", (n, 4), np.int32),
        "depth": get("depth", n, np.float32),
        "radius": get("radius", n, np.float32),
        "state": get("state", n, np.uint8),
        "start": get("start", n + 1, np.int64),
        "count": get("count", n, np.int32),
        "slot": get("slot", n + 1, np.int64),
        "tile_start": get("tile_start", across * down + 1, np.int64),
    }
    with running(0.1 * n):
        project(
            *arrays[:5], t["k"], width, height,
            t["shape"], t["paint"], t["box"], t["depth"], t["radius"], t["state"],
        )  # fmt: skip
        order = tiles.depth_order(t["depth"], t["state"])
        room = tiles.capacities(t["box"], t["state"], t["start"])
        t["tile"] = get("tile", room, np.int32)
        bits = get("bits", room, np.uint8)
        tiles.emit(t["shape"], t["box"], t["state"], t["start"], across, t["tile"], bits, t["count"])
        entries = tiles.slot_starts(t["count"], t["slot"])
        t["list_id"] = get("list_id", entries, np.uint32)
        t["list_slot"] = get("list_slot", entries, np.int32)
        parts = thread_count()
        cursor = get("cursor", (parts, across * down), np.int64)
        tiles.scatter(
            order, t["start"], t["count"], t["slot"], t["tile"], bits, parts, cursor,
            t["tile_start"], t["list_id"], t["list_slot"],
        )  # fmt: skip
    call.culled = int(np.count_nonzero(t["state"] == BAD))
    call.visible = int(np.count_nonzero(t["count"]))
    return t


def _blend(
    background: Array, call: _Call, lease: Lease, t: dict[str, Array]
) -> tuple[torch.Tensor, torch.Tensor]:
    """Composite all tiles; adds the tables that the backward pass needs."""
    width, height = call.camera.width, call.camera.height
    count = len(t["tile_start"]) - 1
    get = lease.buffers.array
    chunks = -(-np.diff(t["tile_start"]) // CHUNK)
    t["chunk_start"] = np.cumsum(chunks) - chunks
    t["kept"] = get("kept", int(chunks.sum()) * PIXELS if call.keep else 0, np.float32)
    t["chunks"] = get("chunks", count, np.int32)
    pairs = get("pairs", count, np.int64)
    image, left = torch.empty(height, width, 3), torch.empty(height, width)
    with running(0.02 * len(t["list_id"]) + 0.005 * width * height):
        composite(
            thread_count(), np.zeros(1, np.int64), -(-width // tiles.TILE),
            t["tile_start"], t["list_id"], t["shape"], t["paint"], background, _t_min(call),
            t["chunk_start"], t["kept"], image.numpy(), left.numpy(), pairs, t["chunks"],
        )  # fmt: skip
    call.pairs = int(pairs.sum())
    return image, left


def _t_min(call: _Call) -> np.float32:
    return np.float32(max(call.limits.t_min, _T_LEAST))


def _gradients(
    arrays: list[Array], call: _Call, lease: Lease, t: dict[str, Array], image: Array, left: Array
) -> list[torch.Tensor]:
    """d loss / d (means, quats, scales, opacities, colours) from d loss / d (image, transmittance)."""
    n, across = len(arrays[0]), -(-call.camera.width // tiles.TILE)
    get = lease.buffers.array
    slots = get("slots", len(t["list_id"]) * SLOT, np.float32)
    found = [torch.empty(array.shape) for array in arrays[:5]]
    screen, weight = get("screen", (n, 2), np.float32), get("weight", n, np.float32)
    with running(0.05 * len(t["list_id"]) + 0.005 * left.size):
        composite_backward(
            thread_count(), np.zeros(1, np.int64), across,
            t["tile_start"], t["list_id"], t["list_slot"], t["shape"], t["paint"], arrays[5], _t_min(call),
            t["chunk_start"], t["chunks"], t["kept"], image, left, slots,
        )  # fmt: skip
    with running(0.1 * n):
        project_backward(
            *arrays[:4], t["k"], t["shape"], t["state"], slots, t["slot"], t["start"], t["tile"], across,
            *(gradient.numpy() for gradient in found), screen, weight,
        )  # fmt: skip
    if call.stats is not None:
        _count(call.stats, call.camera, t["radius"], screen, weight)
    return found


def _count(stats: SplatStats, camera: SplatCamera, radius: Array, screen: Array, weight: Array) -> None:
    """Add one render to the statistics."""
    touched = weight > 0
    stats.seen += touched
    stats.gradient += np.hypot(screen[:, 0] * (camera.width / 2), screen[:, 1] * (camera.height / 2))
    np.maximum(stats.radius, radius * touched, out=stats.radius)
    np.maximum(stats.weight, weight, out=stats.weight)

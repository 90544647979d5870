"""The Triton kernels in order, as one differentiable torch operation.

The host waits for the device twice in a render: for the number of pairs of Gaussians and tiles, which sizes
the tables, and for the counts of the `Render`.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from triton import cdiv, knobs

from recon.splat.camera import SplatCamera
from recon.splat.gpu import composite as forward
from recon.splat.gpu import project as projection
from recon.splat.gpu import slots as sums
from recon.splat.gpu import tiles
from recon.splat.gpu.composite_backward import REGISTERS, SLOT, composite_backward
from recon.splat.gpu.project_backward import project_backward
from recon.splat.gpu.project_view import VIEW
from recon.splat.limits import Limits
from recon.splat.parameters import parameters
from recon.splat.render import Render, SplatStats
from recon.splat.tables import BAD

_T_LEAST = 1e-30
"""Smallest stopping transmittance in float32: below it products would lose digits to denormals."""
_WIDE, _HIGH, _SHAPE = projection.WIDE.value, projection.HIGH.value, projection.SHAPE.value
_PIXELS, _SLOT, _MOMENTS, _VIEW = forward.PIXELS.value, SLOT.value, sums.MOMENTS.value, VIEW.value
_OPTIONS = {"enable_fp_fusion": True}


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


def rasterize_gpu(
    means: torch.Tensor,
    quats: torch.Tensor,
    scales: torch.Tensor,
    opacities: torch.Tensor,
    colours: torch.Tensor,
    camera: SplatCamera,
    background: torch.Tensor | None,
    limits: Limits,
    stats: SplatStats | None,
    view: torch.Tensor | None = None,
) -> Render:
    """As `rasterize`, for float32 tensors on one CUDA device; on the CPU only if Triton interprets.

    view: the camera's numbers where they are to be differentiated (see `recon.splat.moved`), on the CPU.
    ValueError for tensors on the CPU and for more than 2^31 pairs of a Gaussian and a tile of its box.
    """
    if means.device.type != "cuda" and not knobs.runtime.interpret:
        raise ValueError(f"the GPU rasteriser takes CUDA tensors, and means is on {means.device}")
    back = means.new_zeros(3) if background is None else background
    tensors = (means, quats, scales, opacities, colours, back)
    sought = tensors if view is None else (*tensors, view)
    keep = torch.is_grad_enabled() and any(tensor.requires_grad for tensor in sought)
    call = _Call(camera, limits, stats, keep)
    image, left = _Rasterize.apply(*tensors, view, call)  # type: ignore[no-untyped-call]
    return Render(image, 1 - left, call.culled, call.visible, call.pairs)


class _Rasterize(torch.autograd.Function):
    """means, quats, scales, opacities, colours, background, view -> image [H, W, 3], transmittance [H, W]."""

    @staticmethod
    def forward(ctx: Any, *arguments: Any) -> tuple[torch.Tensor, torch.Tensor]:
        *tensors, _, call = arguments
        with torch.cuda.device_of(tensors[0]):  # type: ignore[no-untyped-call]
            tables = _Tables([tensor.detach().contiguous() for tensor in tensors], call)
            image, left = tables.blend()
        if call.keep:
            ctx.save_for_backward(*tensors, left)
            ctx.tables = tables
            ctx.set_materialize_grads(False)
        return image, left

    @staticmethod
    def backward(ctx: Any, *gradients: torch.Tensor | None) -> tuple[torch.Tensor | None, ...]:
        left = ctx.saved_tensors[-1]
        image, light = gradients
        image = left.new_zeros((*left.shape, 3)) if image is None else image.contiguous()
        light = torch.zeros_like(left) if light is None else light.contiguous()
        with torch.cuda.device_of(left):  # type: ignore[no-untyped-call]
            found, view = ctx.tables.gradients(image, light, ctx.needs_input_grad[6])
        back = None
        if ctx.needs_input_grad[5]:
            back = (left.double()[:, :, None] * image).sum(dim=(0, 1)).float()
        return (*found, back, view, None)


class _Tables:
    """All tables of one render, from projection to the end of its backward pass."""

    def __init__(self, tensors: list[torch.Tensor], call: _Call) -> None:
        """Project all Gaussians and list them by tile."""
        *self.tensors, self.background = tensors
        self.call, self.n = call, len(tensors[0])
        new = tensors[0].new_empty
        n, width, height = self.n, call.camera.width, call.camera.height
        self.across = cdiv(width, _WIDE)
        self.tiles = self.across * cdiv(height, _HIGH)
        self.t_min = max(call.limits.t_min, _T_LEAST)
        self.parameters = torch.from_numpy(parameters(call.camera, call.limits)).to(tensors[0].device)
        self.record = new((n, _SHAPE), dtype=torch.float64)
        self.paint = self.record.view(torch.float32)
        self.radius = new(n)
        box, depth = new((n, 4), dtype=torch.int32), new(n)
        state, number = new(n, dtype=torch.int8), new(n, dtype=torch.int64)
        projection.project[(cdiv(n, projection.BLOCK),)](
            *self.tensors, self.parameters, n, self.record, self.paint, box, depth, self.radius, state,
            number, BLOCK=projection.BLOCK, **_OPTIONS,
        )  # fmt: skip
        self.size, call.culled = torch.stack([number.sum(), (state == int(BAD)).sum()]).tolist()
        if self.size >= tiles.MAX_PAIRS:
            raise ValueError(f"{self.size} pairs of Gaussian and tile are too many: render a smaller image")
        start, owner = tiles.pair(number, depth, self.size)
        tile = new(self.size, dtype=tiles.tile_type(self.tiles))
        self.pairs = tiles.Pairs(start, number, owner, tile)
        self.touched = torch.zeros_like(state)
        tiles.match[(cdiv(self.size, tiles.BLOCK),)](
            owner, start, self.record, self.paint, box, tile, self.touched,
            self.size, self.across, self.tiles, BLOCK=tiles.BLOCK, **_OPTIONS,
        )  # fmt: skip
        self.lists = self._sort()

    def _sort(self) -> tiles.Lists:
        """The pairs that touch their tile, by tile."""
        owner, tile = self.pairs.owner, self.pairs.tile
        by_tile, slot = torch.sort(tile, stable=True)
        every = torch.arange(self.tiles + 1, dtype=tile.dtype, device=tile.device)
        start = torch.searchsorted(by_tile, every)
        chunks = torch.div(torch.diff(start) + (tiles.CHUNK - 1), tiles.CHUNK, rounding_mode="floor")
        stride = self.size + tiles.CHUNK
        rows = self.radius.new_empty(tiles.FIELDS, stride)
        tiles.gather[(cdiv(stride, tiles.BLOCK),)](
            slot, owner, by_tile, self.record, self.paint, rows,
            self.size, stride, self.across, self.tiles, BLOCK=tiles.BLOCK, **_OPTIONS,
        )  # fmt: skip
        return tiles.Lists(start, torch.cumsum(chunks, 0) - chunks, slot, rows)

    def blend(self) -> tuple[torch.Tensor, torch.Tensor]:
        """The image [H, W, 3] and what is left of the light behind it [H, W]."""
        call, lists = self.call, self.lists
        width, height = call.camera.width, call.camera.height
        new = self.radius.new_empty
        image, left = new((height, width, 3)), new((height, width))
        pairs, self.chunks = new(self.tiles, dtype=torch.int64), new(self.tiles, dtype=torch.int32)
        # Each tile's last chunk may be short: this many there are at most, known without asking the device.
        self.kept = new((self.size // tiles.CHUNK + self.tiles) * _PIXELS if call.keep else 1)
        forward.composite[(self.tiles,)](
            lists.rows, self.size + tiles.CHUNK, lists.start, lists.chunk_start, self.background, self.t_min,
            self.across, height, width, self.kept, image, left, pairs, self.chunks,
            CHUNK=tiles.CHUNK, KEEP=call.keep, num_warps=1, **_OPTIONS,
        )  # fmt: skip
        call.visible, call.pairs = torch.stack([self.touched.sum(), pairs.sum()]).tolist()
        return image, left

    def gradients(
        self, image: torch.Tensor, left: torch.Tensor, moving: bool
    ) -> tuple[list[torch.Tensor], torch.Tensor | None]:
        """d loss / d (means, quats, scales, opacities, colours) from d loss / d (image, left).

        And d loss / d view, if the camera is `moving`.
        """
        call, lists, pairs, n = self.call, self.lists, self.pairs, self.n
        new = self.radius.new_empty
        slots = self.radius.new_zeros(self.size, _SLOT)
        composite_backward[(self.tiles,)](
            lists.rows, self.size + tiles.CHUNK, lists.start, lists.chunk_start, lists.slot, self.background,
            self.t_min, self.across, call.camera.height, call.camera.width, self.kept, self.chunks,
            image, left, slots, CHUNK=tiles.CHUNK, num_warps=1, maxnreg=REGISTERS, **_OPTIONS,
        )  # fmt: skip
        found = [torch.empty_like(tensor) for tensor in self.tensors]
        moments, weight = new((n, _MOMENTS), dtype=torch.float64), new(n)
        sums.add_slots[(cdiv(n, sums.BLOCK),)](
            slots, pairs.start, pairs.number, pairs.tile, self.record, n, self.across,
            moments, found[4], weight, BLOCK=sums.BLOCK, num_warps=sums.WARPS, **_OPTIONS,
        )  # fmt: skip
        means, quats, scales, opacities, _ = self.tensors
        screen, programs = new((n, 2)), cdiv(n, projection.BLOCK)
        view = new((programs if moving else 1, _VIEW), dtype=torch.float64)
        project_backward[(programs,)](
            means, quats, scales, opacities, self.parameters, n, moments, weight,
            *found[:4], screen, view, BLOCK=projection.BLOCK, MOVING=moving, **_OPTIONS,
        )  # fmt: skip
        if call.stats is not None:
            _count(call.stats, call.camera, self.radius, screen, weight)
        return found, view.sum(dim=0).cpu() if moving else None


def _count(
    stats: SplatStats, camera: SplatCamera, radius: torch.Tensor, screen: torch.Tensor, weight: torch.Tensor
) -> None:
    """Add one render to the statistics, in one transfer from the device."""
    pixels = torch.hypot(screen[:, 0] * (camera.width / 2), screen[:, 1] * (camera.height / 2))
    gradient, radius, weight = torch.stack([pixels, radius * (weight > 0), weight]).cpu().numpy()
    stats.seen += weight > 0
    stats.gradient += gradient
    np.maximum(stats.radius, radius, out=stats.radius)
    np.maximum(stats.weight, weight, out=stats.weight)

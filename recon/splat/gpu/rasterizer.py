"""The Triton kernels in order, as one differentiable torch operation.

The host waits for the device once in a render: for the number of pairs of Gaussians and tiles, which sizes
the tables.
"""

from typing import Any, NamedTuple

import torch
from triton import cdiv, knobs

from recon.splat.gpu import project as projection
from recon.splat.gpu import slots as sums
from recon.splat.gpu import tiles
from recon.splat.gpu.composite import PIXELS, composite
from recon.splat.gpu.composite_backward import SLOT, composite_backward
from recon.splat.gpu.project_backward import project_backward
from recon.splat.gpu.project_view import VIEW
from recon.splat.limits import T_LEAST
from recon.splat.parameters import parameters
from recon.splat.raster_types import RasterInputs, Render, RenderCall
from recon.splat.tables import BAD

_WIDE, _HIGH, _RECORD = projection.WIDE.value, projection.HIGH.value, projection.RECORD.value
_OPTIONS = projection.OPTIONS
_PIXELS, _SLOT, _MOMENTS, _VIEW = PIXELS.value, SLOT.value, sums.MOMENTS.value, VIEW.value


def rasterize_gpu(inputs: RasterInputs) -> Render:
    """Rasterise as `rasterize`, for float32 tensors on one CUDA device; on the CPU only if Triton
    interprets.

    `inputs.view` is on the CPU.
    ValueError for tensors on the CPU and for colours of other than three channels; InputError for 2^27 or
    more pairs of a Gaussian and a tile.
    """
    if inputs.means.device.type != "cuda" and not knobs.runtime.interpret:
        raise ValueError(f"the GPU rasteriser takes CUDA tensors, and means is on {inputs.means.device}")
    if inputs.colours.shape[1] != 3:
        raise ValueError(
            f"the GPU rasteriser draws three channels of light, and colours has {inputs.colours.shape[1]}: "
            "move the tensors to the CPU"
        )
    call = RenderCall.of(inputs)
    image, remaining = _Rasterize.apply(*inputs.tensors, inputs.view, call)  # type: ignore[no-untyped-call]
    return Render(image, 1 - remaining, call.counts)


class _Tables(NamedTuple):
    """Inputs of a render's backward pass, as tensors only: autograd frees them as soon as it may."""

    parameters: torch.Tensor
    radius: torch.Tensor
    start: torch.Tensor
    number: torch.Tensor
    list_start: torch.Tensor
    chunk_start: torch.Tensor
    slot: torch.Tensor
    rows: torch.Tensor
    stored: torch.Tensor
    chunks: torch.Tensor
    """The names are those of the kernels; `start` and `number` as in `tiles.Pairs`."""


class _Rasterize(torch.autograd.Function):
    """means, quats, scales, opacities, colours, background, view -> image [H, W, 3], transmittance [H, W]."""

    @staticmethod
    def forward(ctx: Any, *arguments: Any) -> tuple[torch.Tensor, torch.Tensor]:
        *tensors, _, call = arguments
        with torch.cuda.device_of(tensors[0]):  # type: ignore[no-untyped-call]
            image, remaining, tables = _render([tensor.detach().contiguous() for tensor in tensors], call)
        if call.keep:
            ctx.save_for_backward(*tensors, remaining, *tables)
            ctx.call = call
            ctx.set_materialize_grads(False)
        return image, remaining

    @staticmethod
    def backward(ctx: Any, *gradients: torch.Tensor | None) -> tuple[torch.Tensor | None, ...]:
        *tensors, remaining = ctx.saved_tensors[:7]
        tables = _Tables(*ctx.saved_tensors[7:])
        image, light = gradients
        image = remaining.new_zeros((*remaining.shape, 3)) if image is None else image.contiguous()
        light = torch.zeros_like(remaining) if light is None else light.contiguous()
        with torch.cuda.device_of(remaining):  # type: ignore[no-untyped-call]
            tensors = [tensor.detach().contiguous() for tensor in tensors]
            of_inputs, view = _gradients(tensors, tables, ctx.call, image, light, ctx.needs_input_grad[6])
        back = None
        if ctx.needs_input_grad[5]:
            back = (remaining.double()[:, :, None] * image).sum(dim=(0, 1)).float()
        return (*of_inputs, back, view, None)


def _render(tensors: list[torch.Tensor], call: RenderCall) -> tuple[torch.Tensor, torch.Tensor, _Tables]:
    """The image [H, W, 3] and what remains of the light behind it [H, W]."""
    *gaussians, background = tensors
    new, n = background.new_empty, len(gaussians[0])
    width, height = call.camera.width, call.camera.height
    across, t_min = cdiv(width, _WIDE), max(call.limits.t_min, T_LEAST)
    count = across * cdiv(height, _HIGH)
    numbers = torch.from_numpy(parameters(call.camera, call.limits)).to(background.device, non_blocking=True)
    record, box, depth, radius = new((n, _RECORD)), new((n, 4), dtype=torch.int32), new(n), new(n)
    state = new(n, dtype=torch.int8)
    projection.project[(cdiv(n, projection.BLOCK),)](
        *gaussians, numbers, n, record, box, depth, radius, state,
        BLOCK=projection.BLOCK, FISHEYE=call.camera.fisheye or None, **_OPTIONS,
    )  # fmt: skip
    number = tiles.count(record, box, state, across)
    size = int(number.sum())
    pairs = tiles.pairs_of(number, depth, size, record, box, state, across, count)
    lists = tiles.sort(pairs, record, across, count)
    image, remaining = new((height, width, 3)), new((height, width))
    evaluated, chunks = new(count, dtype=torch.int64), new(count, dtype=torch.int32)
    # Each tile's last chunk may be short: this many there are at most, known without asking the device.
    stored = new((size // tiles.CHUNK + count) * _PIXELS if call.keep else 1)
    composite[(count,)](
        lists.rows, lists.rows.shape[1], lists.start, lists.chunk_start, background, t_min,
        across, height, width, stored, image, remaining, evaluated, chunks,
        CHUNK=tiles.CHUNK, KEEP=call.keep, num_warps=1, **_OPTIONS,
    )  # fmt: skip
    call.counts = lambda: (int((state == int(BAD)).sum()), int((number > 0).sum()), int(evaluated.sum()))
    tables = _Tables(
        numbers, radius, pairs.start, pairs.number,
        lists.start, lists.chunk_start, lists.slot, lists.rows, stored, chunks,
    )  # fmt: skip
    return image, remaining, tables


def _gradients(
    tensors: list[torch.Tensor],
    tables: _Tables,
    call: RenderCall,
    image: torch.Tensor,
    remaining: torch.Tensor,
    moving: bool,
) -> tuple[list[torch.Tensor], torch.Tensor | None]:
    """d loss / d (means, quats, scales, opacities, colours) from d loss / d (image, remaining).

    And d loss / d view, if the camera is `moving`.
    """
    *gaussians, background = tensors
    new, n = background.new_empty, len(gaussians[0])
    width, height = call.camera.width, call.camera.height
    across, t_min = cdiv(width, _WIDE), max(call.limits.t_min, T_LEAST)
    slots = background.new_zeros(len(tables.slot), _SLOT)
    composite_backward[(len(tables.chunks),)](
        tables.rows, tables.rows.shape[1], tables.list_start, tables.chunk_start, tables.slot, background,
        t_min, across, height, width, tables.stored, tables.chunks, image, remaining, slots,
        CHUNK=tiles.CHUNK, num_warps=1, **_OPTIONS,
    )  # fmt: skip
    gradients = [torch.empty_like(tensor) for tensor in gaussians]
    moments, pull, weight = new((n, _MOMENTS)), new(n), new(n)
    sums.add_slots[(cdiv(n, sums.BLOCK),)](
        slots, tables.start, tables.number, n, moments, gradients[4], pull, weight,
        BLOCK=sums.BLOCK, num_warps=sums.WARPS, **_OPTIONS,
    )  # fmt: skip
    programs = cdiv(n, projection.BLOCK)
    view = new((programs if moving else 1, _VIEW), dtype=torch.float64)
    project_backward[(programs,)](
        *gaussians[:4], tables.parameters, n, moments, weight, *gradients[:4], view,
        BLOCK=projection.BLOCK, MOVING=moving, FISHEYE=call.camera.fisheye or None, **_OPTIONS,
    )  # fmt: skip
    if call.stats is not None:
        call.stats.add(call.camera, tables.radius, pull, weight)
    return gradients, view.sum(dim=0).cpu() if moving else None

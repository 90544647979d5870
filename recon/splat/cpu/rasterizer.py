"""The rasteriser on the CPU: the Numba kernels in order, as one differentiable torch operation."""

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import torch

from imaging.arrays import AnyArray, Bytes
from imaging.compute.threads import share, thread_count
from recon.splat.corrected_camera import VIEW
from recon.splat.cpu import tiles
from recon.splat.cpu.composite import CHUNK, PIXELS, composite
from recon.splat.cpu.composite_backward import composite_backward, slot_size
from recon.splat.cpu.project import project
from recon.splat.cpu.project_backward import project_backward
from recon.splat.limits import T_LEAST
from recon.splat.parameters import parameters
from recon.splat.raster_types import RasterInputs, Render, RenderCall
from recon.splat.tables import BAD, Entries, Lists, Projected, shape_size

_LINE = 64
_free: list["Buffers"] = []


class Buffers:
    """A pool of named arrays, grown when needed and never shrunk.

    Fresh megabytes from the system cost more than filling them, and a training step would ask for tens of
    them. Several renders may be alive at once (a batch of views), so each takes a set of its own.
    """

    def __init__(self) -> None:
        self._bytes: dict[str, Bytes] = {}

    def array(self, name: str, shape: int | tuple[int, ...], dtype: npt.DTypeLike) -> AnyArray:
        """An uninitialised array; it is valid until the next request of the same name."""
        kind = np.dtype(dtype)
        sizes = (shape,) if isinstance(shape, int) else shape
        need = math.prod(sizes) * kind.itemsize
        held = self._bytes.get(name)
        if held is None or len(held) < need:
            held = None
            self._bytes.pop(name, None)  # before its successor is there: both together would be the peak
            # A quarter more, so that a slowly growing scene does not ask every time; from a cache line on.
            whole = np.empty(need + need // 4 + _LINE, np.uint8)
            held = whole[-whole.ctypes.data % _LINE :]
            self._bytes[name] = held
        return held[:need].view(kind).reshape(sizes)


class Lease:
    """Holds a set of buffers; they go back to the pool when the last reference to the lease is gone."""

    def __init__(self) -> None:
        try:
            self.buffers = _free.pop()
        except IndexError:
            self.buffers = Buffers()

    def __del__(self, free: list[Buffers] = _free) -> None:  # an argument: it outlives the module at exit
        free.append(self.buffers)


def rasterize_cpu(inputs: RasterInputs) -> Render:
    """Rasterise as `rasterize`, for float32 tensors on the CPU. ValueError for more than 2^28 Gaussians."""
    if len(inputs.means) >= tiles.MAX_GAUSSIANS:
        raise ValueError(f"{len(inputs.means)} Gaussians are more than {tiles.MAX_GAUSSIANS - 1}")
    call = RenderCall.of(inputs)
    image, remaining = _Rasterize.apply(*inputs.tensors, inputs.view, call)  # type: ignore[no-untyped-call]
    return Render(image, 1 - remaining, call.counts)


def _numpy(tensor: torch.Tensor) -> AnyArray:
    """The tensor's memory as a contiguous array."""
    array: AnyArray = tensor.detach().contiguous().numpy()
    return array


class _Rasterize(torch.autograd.Function):
    """means, quats, scales, opacities, colours, background, view -> image [H, W, C], transmittance [H, W].

    The view is the camera's again, as a tensor, so that it gets its gradient.
    """

    @staticmethod
    def forward(ctx: Any, *arguments: Any) -> tuple[torch.Tensor, torch.Tensor]:
        *tensors, _, call = arguments
        arrays = [_numpy(tensor) for tensor in tensors]
        tables = _Tables(Lease(), arrays, call)
        image, remaining = tables.blend(arrays[5])
        if call.keep:
            ctx.save_for_backward(*tensors, remaining)
            ctx.tables = tables
            ctx.set_materialize_grads(False)
        return image, remaining

    @staticmethod
    def backward(ctx: Any, *gradients: torch.Tensor | None) -> tuple[torch.Tensor | None, ...]:
        *tensors, remaining = ctx.saved_tensors
        image, light = gradients
        grad_image = (
            np.zeros((*remaining.shape, tensors[4].shape[1]), np.float32) if image is None else _numpy(image)
        )
        grad_remaining = np.zeros(remaining.shape, np.float32) if light is None else _numpy(light)
        arrays = [_numpy(tensor) for tensor in tensors]
        of_inputs, view = ctx.tables.gradients(arrays, grad_image, grad_remaining, ctx.needs_input_grad[6])
        back = None
        if ctx.needs_input_grad[5]:
            sums = np.einsum("hw,hwc->c", remaining.numpy(), grad_image, dtype=np.float64)
            back = torch.from_numpy(sums.astype(np.float32))
        return (*of_inputs, back, view, None)


class _Tables:
    """All tables of one render, from projection to the end of its backward pass."""

    def __init__(self, lease: Lease, arrays: list[AnyArray], call: RenderCall) -> None:
        """Project all Gaussians and list them by tile."""
        self.lease, self.call = lease, call
        get = lease.buffers.array
        n, width, height = len(arrays[0]), call.camera.width, call.camera.height
        across, down = -(-width // tiles.TILE), -(-height // tiles.TILE)
        self.parameters = parameters(call.camera, call.limits)
        self.fisheye = True if call.camera.fisheye else None
        shape = get("shape", (n, shape_size(arrays[4].shape[1])), np.float64)
        self.projected = Projected(
            shape=shape,
            paint=shape.view(np.float32),
            box=get("box", (n, 4), np.int32),
            depth=get("depth", n, np.float32),
            radius=get("radius", n, np.float32),
            state=get("state", n, np.uint8),
        )
        share(project, 0.1 * n, *arrays[:5], self.parameters, self.fisheye, self.projected)
        state = self.projected.state
        order = tiles.depth_order(self.projected.depth.view(np.uint32), state)
        start = get("start", n + 1, np.int64)
        room = tiles.capacities(self.projected.box, state, start)
        self.entries = Entries(
            start=start,
            number=get("number", n, np.int32),
            slot=get("slot", n + 1, np.int64),
            tile=get("tile", room, np.int32),
            bits=get("bits", room, np.uint8),
        )
        share(tiles.emit, 0.1 * n, self.projected, across, self.entries)
        size = tiles.number_slots(self.entries.number, self.entries.slot)
        tile_start = get("tile_start", across * down + 1, np.int64)
        cursor = get("cursor", (thread_count(), across * down), np.int64)
        share(tiles.count_entries, 0.005 * size, order, self.entries, cursor)
        tiles.place_parts(cursor, tile_start)
        chunks = -(-np.diff(tile_start) // CHUNK)
        self.lists = Lists(
            across=across,
            start=tile_start,
            id=get("id", size, np.uint32),
            slot=get("list_slot", size, np.int32),
            chunk_start=np.cumsum(chunks) - chunks,
        )
        share(tiles.scatter, 0.01 * size, order, self.entries, cursor, self.lists)
        self.stored = get("stored", int(chunks.sum()) * PIXELS if call.keep else 0, np.float32)
        self.chunks = get("chunks", across * down, np.int32)
        self.t_min = np.float32(max(call.limits.t_min, T_LEAST))

    def blend(self, background: AnyArray) -> tuple[torch.Tensor, torch.Tensor]:
        """The image [H, W, C] and what remains of the light behind it [H, W]."""
        width, height = self.call.camera.width, self.call.camera.height
        pairs = self.lease.buffers.array("pairs", len(self.chunks), np.int64)
        image, remaining = torch.empty(height, width, len(background)), torch.empty(height, width)
        share(
            composite, self._work(), self.lists, self.projected, tuple(background), self.t_min,
            self.stored, image.numpy(), remaining.numpy(), pairs, self.chunks,
        )  # fmt: skip
        culled, visible = np.count_nonzero(self.projected.state == BAD), np.count_nonzero(self.entries.number)
        counts = int(culled), int(visible), int(pairs.sum())
        self.call.counts = lambda: counts
        return image, remaining

    def gradients(
        self, arrays: list[AnyArray], image: AnyArray, remaining: AnyArray, moving: bool
    ) -> tuple[list[torch.Tensor], torch.Tensor | None]:
        """d loss / d (means, quats, scales, opacities, colours) from d loss / d (image, remaining).

        And d loss / d view, if the camera is `moving`.
        """
        get = self.lease.buffers.array
        n = len(arrays[0])
        slots = get("slots", len(self.lists.id) * slot_size(len(arrays[5])), np.float32)
        gradients = [torch.empty(array.shape) for array in arrays[:5]]
        pull, weight = get("pull", n, np.float32), get("weight", n, np.float32)
        view = np.empty((-(-n // tiles.TASK), VIEW)) if moving else None
        share(
            composite_backward, self._work(), self.lists, self.projected, tuple(arrays[5]), self.t_min,
            self.stored, self.chunks, image, remaining, slots,
        )  # fmt: skip
        share(
            project_backward, 0.1 * n, *arrays[:4], self.parameters, self.fisheye, self.projected,
            self.entries, self.lists.across, slots, *(gradient.numpy() for gradient in gradients),
            pull, weight, view,
        )  # fmt: skip
        if self.call.stats is not None:
            counts = (torch.from_numpy(count) for count in (self.projected.radius, pull, weight))
            self.call.stats.add(self.call.camera, *counts)
        return gradients, None if view is None else torch.from_numpy(view.sum(axis=0))

    def _work(self) -> float:
        """Microseconds that compositing will take, roughly."""
        return 0.05 * len(self.lists.id) + 0.003 * self.call.camera.width * self.call.camera.height

# mypy: allow-untyped-defs, allow-incomplete-defs, allow-untyped-calls, allow-untyped-decorators
"""Assignment of Gaussians to tiles, nearest first: one thread a pair of a Gaussian and a tile of its box.

Pairs are numbered Gaussian after Gaussian in order of depth; a stable sort by tile then gives each tile its
list. A pair whose ellipse misses the tile gets the number behind the last tile, and so sorts to the end:
cheaper than counting first what is hit. A pair's number is also its gradient slot.
"""

from typing import NamedTuple

import torch
import triton
import triton.language as tl
from triton import cdiv

from imaging.errors import InputError
from recon.splat.gpu.project import HIGH, OPTIONS, PAINT, SHAPE, WIDE

BLOCK = 256
"""Pairs of a program."""
CHUNK = 8
"""Entries of a list between two stored transmittances; also what a list's rows are padded with."""
FIELDS = 10
"""Rows of a table of entries: see `gather`."""
MAX_PAIRS = 1 << 27
"""More pairs than there may be, for 32-bit offsets of a table's rows; memory mostly ends before."""
_MAX_INT16 = (1 << 15) - 1
_SLACK = tl.constexpr(1e-6)
"""The ellipse is widened by this fraction, so that rounding never drops a pixel that it touches."""


class Pairs(NamedTuple):
    """Gaussians and the tiles of their boxes; M pairs."""

    start: torch.Tensor
    """int64 [N]: each Gaussian's first pair."""
    number: torch.Tensor
    """int64 [N]: how many pairs it has."""
    owner: torch.Tensor
    """int32 [M]: the Gaussian."""
    tile: torch.Tensor
    """int16 or int32 [M]: the tile, or the number of tiles where the ellipse misses it."""


class Lists(NamedTuple):
    """The entries of each tile, nearest first."""

    start: torch.Tensor
    """int64 [tiles + 1]: where each tile's list begins."""
    chunk_start: torch.Tensor
    """int64 [tiles]: where a tile's chunks begin, all tiles counted."""
    slot: torch.Tensor
    """int64 [M]: an entry's pair."""
    rows: torch.Tensor
    """float32 [FIELDS, M + CHUNK]: see `gather`; zeros behind the last list."""


@triton.jit(do_not_specialize=["pairs", "across", "tiles"])
def match(
    owner, start, record, paint, box, tile, touched, pairs, across, tiles, BLOCK: tl.constexpr
):  # fmt: skip
    """Fill tile [pairs] (see `Pairs`), and set touched int8 [N] to 1 for Gaussians that touch any."""
    pair = tl.program_id(0).to(tl.int64) * BLOCK + tl.arange(0, BLOCK)
    here = pair < pairs
    i = tl.load(owner + pair, mask=here, other=0).to(tl.int64)
    rank = (pair - tl.load(start + i, mask=here, other=0)).to(tl.int32)
    at = box + 4 * i
    first_x, last_x = tl.load(at, mask=here, other=0), tl.load(at + 1, mask=here, other=0)
    first_y, last_y = tl.load(at + 2, mask=here, other=0), tl.load(at + 3, mask=here, other=0)
    at = record + i * SHAPE
    px, py = tl.load(at, mask=here, other=0.0), tl.load(at + 1, mask=here, other=0.0)
    m11, m21 = tl.load(at + 2, mask=here, other=1.0), tl.load(at + 3, mask=here, other=0.0)
    m22 = tl.load(at + 4, mask=here, other=1.0)
    reach = -tl.load(paint + i * (2 * SHAPE) + PAINT, mask=here, other=0.0).to(tl.float64)
    reach = reach * (1.0 + _SLACK) + _SLACK
    columns = last_x // WIDE - first_x // WIDE + 1
    x_tile, y_tile = first_x // WIDE + rank % columns, first_y // HIGH + rank // columns

    # The tile's pixel columns are an interval of dx, and there the ellipse spans the rows first .. last. Its
    # upper edge dy(dx) = (-m21 dx + sqrt(reach - (m11 dx)^2)) / m22 is concave, so its largest value is at
    # the interval's point nearest to the top of the ellipse; the lower edge mirrors it.
    half = tl.sqrt(reach) / m11
    top = -half * m21 / tl.sqrt(m11 * m11 + m21 * m21)
    left = (x_tile * WIDE).to(tl.float64) + 0.5 - px
    low, high = tl.maximum(left, -half), tl.minimum(left + (WIDE - 1.0), half)
    x = tl.minimum(tl.maximum(top, low), high)
    y = (tl.sqrt(tl.maximum(reach - (x * m11) * (x * m11), 0.0)) - x * m21) / m22
    last = tl.floor(tl.minimum(y + (py - 0.5), last_y.to(tl.float64)))
    x = tl.minimum(tl.maximum(-top, low), high)
    y = (-tl.sqrt(tl.maximum(reach - (x * m11) * (x * m11), 0.0)) - x * m21) / m22
    first = tl.ceil(tl.maximum(y + (py - 0.5), first_y.to(tl.float64)))
    upper = (y_tile * HIGH).to(tl.float64)
    hit = (high >= low) & (last >= tl.maximum(first, upper)) & (first <= upper + (HIGH - 1.0))

    place = tl.where(hit, y_tile * across + x_tile, tiles)
    tl.store(tile + pair, place.to(tile.dtype.element_ty), mask=here)
    tl.store(touched + i, 1, mask=here & hit)


@triton.jit(do_not_specialize=["pairs", "across", "tiles"])
def gather(
    slot, owner, sorted_tile, record, paint, rows, pairs, stride, across, tiles, BLOCK: tl.constexpr
):  # fmt: skip
    """Copy what a tile needs of its entries to rows float32 [FIELDS, stride], in the order of the lists.

    Fields: y1, y2 (m11 dx and m21 dx + m22 dy at the tile's first pixel, subtracted in float64),
    m11, m21, m22, -reach, opacity, red, green, blue.
    """
    entry = tl.program_id(0).to(tl.int64) * BLOCK + tl.arange(0, BLOCK)
    here = entry < pairs
    tile = tl.load(sorted_tile + entry, mask=here, other=0).to(tl.int32)
    here = here & (tile < tiles)
    pair = tl.load(slot + entry, mask=here, other=0)
    i = tl.load(owner + pair, mask=here, other=0).to(tl.int64)
    at = record + i * SHAPE
    dx = (tile % across * WIDE).to(tl.float64) + 0.5 - tl.load(at, mask=here, other=0.0)
    dy = (tile // across * HIGH).to(tl.float64) + 0.5 - tl.load(at + 1, mask=here, other=0.0)
    m11, m21 = tl.load(at + 2, mask=here, other=0.0), tl.load(at + 3, mask=here, other=0.0)
    m22 = tl.load(at + 4, mask=here, other=0.0)
    room, to = entry < stride, rows + entry
    tl.store(to, (m11 * dx).to(tl.float32), mask=room)
    tl.store(to + stride, (m21 * dx + m22 * dy).to(tl.float32), mask=room)
    tl.store(to + 2 * stride, m11.to(tl.float32), mask=room)
    tl.store(to + 3 * stride, m21.to(tl.float32), mask=room)
    tl.store(to + 4 * stride, m22.to(tl.float32), mask=room)
    at = paint + i * (2 * SHAPE) + PAINT
    for field in tl.static_range(5):
        tl.store(to + (5 + field) * stride, tl.load(at + field, mask=here, other=0.0), mask=room)


def match_all(
    number: torch.Tensor,
    depth: torch.Tensor,
    size: int,
    record: torch.Tensor,
    paint: torch.Tensor,
    box: torch.Tensor,
    across: int,
    tiles: int,
) -> tuple[Pairs, torch.Tensor]:
    """All pairs, in order of depth with ties in order of index; and `touched` of `match`.

    number int64 [N] and what follows: from `project`; size: the sum of number. InputError for too many.
    """
    if size >= MAX_PAIRS:
        raise InputError(
            f"A view has {size:,} pairs of a Gaussian and a tile, and the GPU's kernels take {MAX_PAIRS:,}: "
            "give a smaller --set width or --set gaussians."
        )
    order = torch.sort(depth, stable=True).indices
    counts = number[order]
    start = torch.empty_like(number)
    start[order] = torch.cumsum(counts, 0) - counts
    owner = torch.repeat_interleave(order.to(torch.int32), counts, output_size=size)
    # The smallest type that holds every number: half the time of a radix sort.
    tile = number.new_empty(size, dtype=torch.int16 if tiles <= _MAX_INT16 else torch.int32)
    touched = number.new_zeros(len(number), dtype=torch.int8)
    match[(cdiv(size, BLOCK),)](
        owner, start, record, paint, box, tile, touched, size, across, tiles, BLOCK=BLOCK, **OPTIONS
    )
    return Pairs(start, number, owner, tile), touched


def sort(pairs: Pairs, record: torch.Tensor, paint: torch.Tensor, across: int, tiles: int) -> Lists:
    """The pairs that touch their tile, by tile."""
    by_tile, slot = torch.sort(pairs.tile, stable=True)
    every = torch.arange(tiles + 1, dtype=by_tile.dtype, device=by_tile.device)
    start = torch.searchsorted(by_tile, every)
    chunks = torch.div(torch.diff(start) + (CHUNK - 1), CHUNK, rounding_mode="floor")
    size, stride = len(by_tile), len(by_tile) + CHUNK
    rows = paint.new_empty(FIELDS, stride)
    gather[(cdiv(stride, BLOCK),)](
        slot, pairs.owner, by_tile, record, paint, rows, size, stride, across, tiles, BLOCK=BLOCK, **OPTIONS
    )
    return Lists(start, torch.cumsum(chunks, 0) - chunks, slot, rows)

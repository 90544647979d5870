# mypy: allow-untyped-defs, allow-incomplete-defs, allow-untyped-calls, allow-untyped-decorators
"""Assignment of Gaussians to tiles, nearest first: one thread a Gaussian, row of tiles after row.

`match` runs twice: it counts the tiles that each ellipse touches, and, when the host knows how many pairs
that makes, writes them, Gaussian after Gaussian in order of depth. A stable sort by tile then gives each tile
its list. A pair's number is also its gradient slot. All is float32: what rounding could drop is added as
slack.
"""

from typing import NamedTuple

import torch
import triton
import triton.language as tl
from triton import cdiv

from imaging.errors import InputError
from recon.splat.gpu.project import DRAWN, HIGH, OPTIONS, PAINT, RECORD, WIDE

BLOCK = 256
"""Entries of a program of `gather`."""
MATCHED = 32
"""Gaussians of a program of `match`: a warp's, which wait for no other."""
CHUNK = 4
"""Entries of a list between two stored transmittances; also what a list's rows are padded with. On an H200 a
frame of 100,000 Gaussians blends there and back in 0.57 ms with 4, 0.63 with 8 and 0.60 with 2; one of a
million with cut-offs for high contrast in 4.07, 3.74 and 4.54."""
FIELDS = 10
"""Rows of a table of entries: see `gather`."""
EXACT = {"enable_fp_fusion": False, "num_warps": 1}
"""Options of both launches of `match`: without contracted products they agree to the last bit, so that what
one counts the other writes."""
MAX_PAIRS = 1 << 27
"""More pairs than there may be, for 32-bit offsets of a table's rows; memory mostly ends before."""
_MAX_INT16 = (1 << 15) - 1
_SLACK = tl.constexpr(1e-5)
"""The ellipse is widened by this fraction, a hundred roundings of float32, so that none of them drops a pixel
that it touches."""


class Pairs(NamedTuple):
    """Gaussians and the tiles that they touch; M pairs."""

    start: torch.Tensor
    """int64 [N]: each Gaussian's first pair."""
    number: torch.Tensor
    """int64 [N]: how many pairs it has."""
    owner: torch.Tensor
    """int32 [M]: the Gaussian."""
    tile: torch.Tensor
    """int16 or int32 [M]: the tile."""


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


@triton.jit
def _columns(shape, row, first_x, last_x, first_y, last_y):
    """First and last column of tiles that an ellipse touches in a row of tiles; an empty range for none.

    Its pixel rows are an interval of dy, in which q = (n22 dy)^2 + (n11 dx + n12 dy)^2 <= reach spans dx. The
    right edge is concave, so that its largest value is at the interval's point nearest to that of the
    rightmost pixel; the left edge mirrors it.
    """
    px, px_rest, py, py_rest, m11, m21, m22, reach = shape
    reach = reach * (1.0 + _SLACK) + _SLACK
    n11 = tl.sqrt(m11 * m11 + m21 * m21)
    n22, slant = m11 * (m22 / n11), (m21 / n11) * (m22 / n11)
    half = tl.sqrt(reach) / n22
    top = tl.maximum(row * HIGH, first_y).to(tl.float32)
    bottom = tl.minimum(row * HIGH + (HIGH - 1), last_y).to(tl.float32)
    low = tl.maximum((top + 0.5 - py) - py_rest, -half)
    high = tl.minimum((bottom + 0.5 - py) - py_rest, half)
    rightmost = -(tl.sqrt(reach) / m11) * (m21 / m22)
    y = tl.minimum(tl.maximum(rightmost, low), high)
    width = tl.sqrt(tl.maximum(reach - (y * n22) * (y * n22), 0.0)) / n11
    right = px + ((width - y * slant) + (px_rest - 0.5))
    right += _SLACK * (tl.abs(px) + width + tl.abs(y * slant) + 1.0)
    y = tl.minimum(tl.maximum(-rightmost, low), high)
    width = tl.sqrt(tl.maximum(reach - (y * n22) * (y * n22), 0.0)) / n11
    left = px - ((width + y * slant) - (px_rest - 0.5))
    left -= _SLACK * (tl.abs(px) + width + tl.abs(y * slant) + 1.0)
    first = tl.ceil(tl.maximum(left, first_x.to(tl.float32))).to(tl.int32)
    last = tl.floor(tl.minimum(right, last_x.to(tl.float32))).to(tl.int32)
    first, last = tl.minimum(first, last_x + 1), tl.maximum(last, first_x - 1)
    hit = (high >= low) & (last >= first)
    return tl.where(hit, first // WIDE, 0), tl.where(hit, last // WIDE, -1)


@triton.jit(do_not_specialize=["n", "across"])
def match(
    record, box, state, n, across, number, start, owner, tile, BLOCK: tl.constexpr, WRITE: tl.constexpr
):
    """Count the tiles that each of N Gaussians touches into number int64 [N]; or if WRITE, write its pairs.

    These are owner and tile, see `Pairs`, from start int64 [N] on.
    """
    i = tl.program_id(0).to(tl.int64) * BLOCK + tl.arange(0, BLOCK)
    here = i < n
    drawn = here & (tl.load(state + i, mask=here, other=0) == DRAWN)
    at = box + 4 * i
    first_x, last_x = tl.load(at, mask=drawn, other=0), tl.load(at + 1, mask=drawn, other=0)
    first_y, last_y = tl.load(at + 2, mask=drawn, other=0), tl.load(at + 3, mask=drawn, other=-1)
    at = record + i * RECORD
    shape = (
        tl.load(at, mask=drawn, other=0.0),
        tl.load(at + 1, mask=drawn, other=0.0),
        tl.load(at + 2, mask=drawn, other=0.0),
        tl.load(at + 3, mask=drawn, other=0.0),
        tl.load(at + 4, mask=drawn, other=1.0),
        tl.load(at + 5, mask=drawn, other=0.0),
        tl.load(at + 7, mask=drawn, other=1.0),
        -tl.load(at + PAINT, mask=drawn, other=0.0),
    )
    top = first_y // HIGH
    rows = tl.where(drawn, last_y // HIGH - top + 1, 0)
    count = tl.zeros([BLOCK], tl.int64)
    to = tl.load(start + i, mask=here, other=0) if WRITE else count
    row, most = 0, tl.max(rows, axis=0)
    while row < most:
        first, last = _columns(shape, top + row, first_x, last_x, first_y, last_y)
        span = tl.where(row < rows, last - first + 1, 0)
        if WRITE:
            column, widest = 0, tl.max(span, axis=0)
            while column < widest:
                inside = column < span
                place = (top + row) * across + first + column
                tl.store(tile + to + column, place.to(tile.dtype.element_ty), mask=inside)
                tl.store(owner + to + column, i.to(tl.int32), mask=inside)
                column += 1
            to += span
        else:
            count += span
        row += 1
    if not WRITE:
        tl.store(number + i, count, mask=here)


@triton.jit
def _less(a, b):
    """a - b, and what float32 leaves of it."""
    c = a - b
    back = c - a
    return c, (a - (c - back)) - (b + back)


@triton.jit(do_not_specialize=["pairs", "stride", "across"])
def gather(slot, owner, sorted_tile, record, rows, pairs, stride, across, BLOCK: tl.constexpr):
    """Copy what a tile needs of its entries to rows float32 [FIELDS, stride], in the order of the lists.

    Fields: y1, y2 (m11 dx and m21 dx + m22 dy at the tile's first pixel), m11, m21, m22, -reach, opacity,
    red, green, blue. In a needle the sum y2 cancels: it is that of 48 bits, by Kahan's difference of products
    (Jeannerod et al. 2013, doi 10.1090/S0025-5718-2013-02679-8).
    """
    entry = tl.program_id(0).to(tl.int64) * BLOCK + tl.arange(0, BLOCK)
    here = entry < pairs
    tile = tl.load(sorted_tile + entry, mask=here, other=0).to(tl.int32)
    pair = tl.load(slot + entry, mask=here, other=0)
    i = tl.load(owner + pair, mask=here, other=0).to(tl.int64)
    at = record + i * RECORD
    x, y = (tile % across * WIDE).to(tl.float32) + 0.5, (tile // across * HIGH).to(tl.float32) + 0.5
    dx, dx_rest = _less(x, tl.load(at, mask=here, other=0.0))
    dy, dy_rest = _less(y, tl.load(at + 2, mask=here, other=0.0))
    dx_rest -= tl.load(at + 1, mask=here, other=0.0)
    dy_rest -= tl.load(at + 3, mask=here, other=0.0)
    m11 = tl.load(at + 4, mask=here, other=0.0)
    m21, m21_rest = tl.load(at + 5, mask=here, other=0.0), tl.load(at + 6, mask=here, other=0.0)
    m22, m22_rest = tl.load(at + 7, mask=here, other=0.0), tl.load(at + 8, mask=here, other=0.0)
    product = m22 * dy
    rest = tl.fma(m22, dy, -product) + m21 * dx_rest + m21_rest * dx + m22 * dy_rest + m22_rest * dy
    room, to = entry < stride, rows + entry
    tl.store(to, tl.fma(m11, dx, m11 * dx_rest), mask=room)
    tl.store(to + stride, tl.fma(m21, dx, product) + rest, mask=room)
    tl.store(to + 2 * stride, m11, mask=room)
    tl.store(to + 3 * stride, m21, mask=room)
    tl.store(to + 4 * stride, m22, mask=room)
    for field in tl.static_range(5):
        tl.store(to + (5 + field) * stride, tl.load(at + (PAINT + field), mask=here, other=0.0), mask=room)


def count(record: torch.Tensor, box: torch.Tensor, state: torch.Tensor, across: int) -> torch.Tensor:
    """Return how many tiles each Gaussian touches, int64 [N]; tables from `project`."""
    n = len(state)
    number = torch.empty(n, dtype=torch.int64, device=state.device)
    match[(cdiv(n, MATCHED),)](
        record, box, state, n, across, number, number, number, number, BLOCK=MATCHED, WRITE=False, **EXACT
    )
    return number


def pairs_of(
    number: torch.Tensor,
    depth: torch.Tensor,
    size: int,
    record: torch.Tensor,
    box: torch.Tensor,
    state: torch.Tensor,
    across: int,
    tiles: int,
) -> Pairs:
    """List all pairs, in order of depth with ties in order of index.

    number: from `count`; size: its sum. InputError for too many.
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
    owner = number.new_empty(size, dtype=torch.int32)
    # The smallest type that holds every number: half the time of a radix sort.
    tile = number.new_empty(size, dtype=torch.int16 if tiles <= _MAX_INT16 else torch.int32)
    n = len(number)
    match[(cdiv(n, MATCHED),)](
        record, box, state, n, across, number, start, owner, tile, BLOCK=MATCHED, WRITE=True, **EXACT
    )
    return Pairs(start, number, owner, tile)


def sort(pairs: Pairs, record: torch.Tensor, across: int, tiles: int) -> Lists:
    """The pairs by tile."""
    by_tile, slot = torch.sort(pairs.tile, stable=True)
    every = torch.arange(tiles + 1, dtype=by_tile.dtype, device=by_tile.device)
    start = torch.searchsorted(by_tile, every)
    chunks = torch.div(torch.diff(start) + (CHUNK - 1), CHUNK, rounding_mode="floor")
    size, stride = len(by_tile), len(by_tile) + CHUNK
    rows = record.new_empty(FIELDS, stride)
    gather[(cdiv(stride, BLOCK),)](
        slot, pairs.owner, by_tile, record, rows, size, stride, across, BLOCK=BLOCK, **OPTIONS
    )
    return Lists(start, torch.cumsum(chunks, 0) - chunks, slot, rows)

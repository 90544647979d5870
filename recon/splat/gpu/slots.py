# mypy: allow-untyped-defs, allow-incomplete-defs, allow-untyped-calls, allow-untyped-decorators
"""Adding up each Gaussian's gradient slots, in an order that depends on nothing but their number.

A Gaussian that covers the image has thousands of slots and most have a few, so sixteen lanes share one.
"""

import triton
import triton.language as tl

from recon.splat.gpu.composite_backward import SLOT
from recon.splat.gpu.project import HIGH, SHAPE, WIDE

BLOCK = 8
"""Gaussians of a program."""
WARPS = 1
MOMENTS = tl.constexpr(6)
"""Sums over pixels of s, s dx, s dy, s dx dx, s dx dy, s dy dy: s = alpha d loss / d alpha, (dx, dy) from
the mean to the pixel."""
_LANES = tl.constexpr(16)


@triton.jit(do_not_specialize=["n", "across"])
def add_slots(
    slots, start, number, tile, record, n, across, moments, grad_colours, pull, weight,
    BLOCK: tl.constexpr,
):  # fmt: skip
    """Fill moments float64 [N, MOMENTS], grad_colours float32 [N, 3], pull and weight float32 [N].

    pull: sqrt((sum |s|)^2 - (sum s)^2); weight: the largest.
    """
    i = tl.program_id(0).to(tl.int64) * BLOCK + tl.arange(0, BLOCK)
    here = i < n
    count = tl.load(number + i, mask=here, other=0)
    drawn = count > 0
    begin = tl.load(start + i, mask=here, other=0)[:, None]
    px = tl.load(record + i * SHAPE, mask=drawn, other=0.0)[:, None]
    py = tl.load(record + i * SHAPE + 1, mask=drawn, other=0.0)[:, None]
    lane = tl.arange(0, _LANES)[None, :]
    zero = tl.zeros([BLOCK, _LANES], tl.float64)
    s, sx, sy, sxx, sxy, syy = zero, zero, zero, zero, zero, zero
    red, green, blue, total = zero, zero, zero, zero
    peak = tl.zeros([BLOCK, _LANES], tl.float32)
    done, most = 0, tl.max(count).to(tl.int32)
    while done < most:
        there = done + lane < count[:, None]
        slot = begin + done + lane
        t = tl.load(tile + slot, mask=there, other=0).to(tl.int32)
        ox = (t % across * WIDE).to(tl.float64) - px + 0.5 * WIDE
        oy = (t // across * HIGH).to(tl.float64) - py + 0.5 * HIGH
        at = slots + slot * SLOT
        m = tl.load(at, mask=there, other=0.0).to(tl.float64)
        mx = tl.load(at + 1, mask=there, other=0.0).to(tl.float64)
        my = tl.load(at + 2, mask=there, other=0.0).to(tl.float64)
        s += m
        sx += mx + ox * m
        sy += my + oy * m
        sxx += tl.load(at + 3, mask=there, other=0.0) + 2.0 * ox * mx + ox * ox * m
        sxy += tl.load(at + 4, mask=there, other=0.0) + ox * my + oy * mx + ox * oy * m
        syy += tl.load(at + 5, mask=there, other=0.0) + 2.0 * oy * my + oy * oy * m
        red += tl.load(at + 6, mask=there, other=0.0)
        green += tl.load(at + 7, mask=there, other=0.0)
        blue += tl.load(at + 8, mask=there, other=0.0)
        total += tl.load(at + 9, mask=there, other=0.0)
        peak = tl.maximum(peak, tl.load(at + 10, mask=there, other=0.0))
        done += _LANES
    to = moments + i * MOMENTS
    tl.store(to, tl.sum(s, axis=1), mask=here)
    tl.store(to + 1, tl.sum(sx, axis=1), mask=here)
    tl.store(to + 2, tl.sum(sy, axis=1), mask=here)
    tl.store(to + 3, tl.sum(sxx, axis=1), mask=here)
    tl.store(to + 4, tl.sum(sxy, axis=1), mask=here)
    tl.store(to + 5, tl.sum(syy, axis=1), mask=here)
    to = grad_colours + 3 * i
    tl.store(to, tl.sum(red, axis=1).to(tl.float32), mask=here)
    tl.store(to + 1, tl.sum(green, axis=1).to(tl.float32), mask=here)
    tl.store(to + 2, tl.sum(blue, axis=1).to(tl.float32), mask=here)
    strength, net = tl.sum(total, axis=1), tl.sum(s, axis=1)
    both = tl.sqrt(tl.maximum(strength * strength - net * net, 0.0))
    tl.store(pull + i, both.to(tl.float32), mask=here)
    tl.store(weight + i, tl.max(peak, axis=1), mask=here)

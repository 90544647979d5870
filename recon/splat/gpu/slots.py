# mypy: allow-untyped-defs, allow-incomplete-defs, allow-untyped-calls, allow-untyped-decorators
"""Adding up each Gaussian's gradient slots, in an order that depends on nothing but their number.

A Gaussian that covers the image has thousands of slots and most have a few, so sixteen lanes share one.
float32: the slots count from the Gaussian's own mean, in its own units, so that their sums do not cancel.
"""

import triton
import triton.language as tl

from recon.splat.gpu.composite_backward import SLOT

BLOCK = 8
"""Gaussians of a program."""
WARPS = 1
MOMENTS = tl.constexpr(6)
"""Sums over pixels of s, s y1, s y2, s y1 y1, s y1 y2, s y2 y2: s = alpha d loss / d alpha, (y1, y2) the
whitened place of the pixel from the mean."""
_LANES = tl.constexpr(16)


@triton.jit(do_not_specialize=["n"])
def add_slots(slots, start, number, n, moments, grad_colours, pull, weight, BLOCK: tl.constexpr):
    """Fill moments float32 [N, MOMENTS], grad_colours float32 [N, 3], pull and weight float32 [N].

    pull: sqrt((sum |s|)^2 - (sum s)^2); weight: the largest.
    """
    i = tl.program_id(0).to(tl.int64) * BLOCK + tl.arange(0, BLOCK)
    here = i < n
    count = tl.load(number + i, mask=here, other=0)
    begin = tl.load(start + i, mask=here, other=0)[:, None]
    lane = tl.arange(0, _LANES)[None, :]
    zero = tl.zeros([BLOCK, _LANES], tl.float32)
    s, sy1, sy2, s11, s12, s22 = zero, zero, zero, zero, zero, zero
    red, green, blue, total, peak = zero, zero, zero, zero, zero
    done, most = 0, tl.max(count).to(tl.int32)
    while done < most:
        there = done + lane < count[:, None]
        at = slots + (begin + done + lane) * SLOT
        s += tl.load(at, mask=there, other=0.0)
        sy1 += tl.load(at + 1, mask=there, other=0.0)
        sy2 += tl.load(at + 2, mask=there, other=0.0)
        s11 += tl.load(at + 3, mask=there, other=0.0)
        s12 += tl.load(at + 4, mask=there, other=0.0)
        s22 += tl.load(at + 5, mask=there, other=0.0)
        red += tl.load(at + 6, mask=there, other=0.0)
        green += tl.load(at + 7, mask=there, other=0.0)
        blue += tl.load(at + 8, mask=there, other=0.0)
        total += tl.load(at + 9, mask=there, other=0.0)
        peak = tl.maximum(peak, tl.load(at + 10, mask=there, other=0.0))
        done += _LANES
    net, strength = tl.sum(s, axis=1), tl.sum(total, axis=1)
    to = moments + i * MOMENTS
    tl.store(to, net, mask=here)
    tl.store(to + 1, tl.sum(sy1, axis=1), mask=here)
    tl.store(to + 2, tl.sum(sy2, axis=1), mask=here)
    tl.store(to + 3, tl.sum(s11, axis=1), mask=here)
    tl.store(to + 4, tl.sum(s12, axis=1), mask=here)
    tl.store(to + 5, tl.sum(s22, axis=1), mask=here)
    to = grad_colours + 3 * i
    tl.store(to, tl.sum(red, axis=1), mask=here)
    tl.store(to + 1, tl.sum(green, axis=1), mask=here)
    tl.store(to + 2, tl.sum(blue, axis=1), mask=here)
    # Two roots, since the squares could overflow.
    both = tl.sqrt(tl.maximum(strength - net, 0.0)) * tl.sqrt(tl.maximum(strength + net, 0.0))
    tl.store(pull + i, both, mask=here)
    tl.store(weight + i, tl.max(peak, axis=1), mask=here)

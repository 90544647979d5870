# mypy: allow-untyped-defs, allow-incomplete-defs, allow-untyped-calls, allow-untyped-decorators
"""The gradient of `composite`: each tile's list back to front, without dividing by 1 - alpha.

With g = d loss / d pixel, w = alpha T and B = what lies behind a layer, blended, dotted with g:
`d loss / d alpha = T (colour . g - B)`, and in front of that layer `B + alpha (colour . g - B)`.
T comes from the stored transmittances, multiplied forward through a chunk; with alpha it stays in registers.
Every entry has its own slot of sums, so that no sum depends on which program ran when. As in the forward
pass, one warp does a tile: its sums need neither shared memory nor a barrier.
"""

import triton
import triton.language as tl

from recon.splat.gpu.composite import PIXELS, cover, places, read_colour, read_ellipse
from recon.splat.gpu.inputs import appended
from recon.splat.gpu.project import HIGH, WIDE

_REGISTERS = 128
SLOT = tl.constexpr(11)
"""Floats of a slot: with s = alpha d loss / d alpha at a pixel and (x, y) its place from the tile's centre,
the sums of s, s x, s y, s x x, s x y, s y y, then of w g (3) and of |s|, then the largest w."""
_MIDDLE_X, _MIDDLE_Y = tl.constexpr((WIDE.value - 1) / 2), tl.constexpr((HIGH.value - 1) / 2)


def register_cap(hip: object) -> dict[str, int]:
    """Option of the launch of `composite_backward`: most registers of a thread, where not on ROCm (`hip`).

    Left alone ptxas takes 198 for sm_90, and 10 warps would fit where 16 do; it pays with 5 % more
    instructions (ptxas of CUDA 12.9, counted, not timed). ROCm's launch refuses an option that it does not
    know, and its compiler takes fewer by itself.
    """
    return {} if hip else {"maxnreg": _REGISTERS}


@triton.jit
def _walk(rows, stride, first, stop, x, y, light, t_min, CHUNK: tl.constexpr):
    """Forward through a chunk: before each entry the transmittances, and its alphas, 0 where not touched."""
    lights, alphas = (), ()
    for j in tl.static_range(CHUNK):
        touched, alpha, through = cover(read_ellipse(rows, stride, first + j, stop), x, y, light, t_min)
        lights = appended(lights, light)
        alphas = appended(alphas, tl.where(touched, alpha, 0.0))
        light = tl.where(touched, light * through, light)
    return lights, alphas


@triton.jit
def _totals(s, w, g):
    """A slot's floats, in lanes: s, w [4, 32] at the pixels, g their gradients."""
    lane = tl.arange(0, 32)
    step = (2 * tl.arange(0, 4)).to(tl.float32)[:, None]
    x, y = (lane & 15).to(tl.float32) - _MIDDLE_X, (lane >> 4).to(tl.float32) - _MIDDLE_Y
    # A lane's pixels share x, and lie at y + step.
    m0, m1, m2 = tl.sum(s, axis=0), tl.sum(s * step, axis=0), tl.sum(s * (step * step), axis=0)
    sy = tl.fma(m0, y, m1)
    sx, syy = m0 * x, tl.fma(y, sy, tl.fma(y, m1, m2))
    totals = tl.where(lane == 0, tl.sum(m0, axis=0), 0.0)
    totals = tl.where(lane == 1, tl.sum(sx, axis=0), totals)
    totals = tl.where(lane == 2, tl.sum(sy, axis=0), totals)
    totals = tl.where(lane == 3, tl.sum(sx * x, axis=0), totals)
    totals = tl.where(lane == 4, tl.sum(sy * x, axis=0), totals)
    totals = tl.where(lane == 5, tl.sum(syy, axis=0), totals)
    totals = tl.where(lane == 6, tl.sum(tl.sum(w * g[0], axis=0), axis=0), totals)
    totals = tl.where(lane == 7, tl.sum(tl.sum(w * g[1], axis=0), axis=0), totals)
    totals = tl.where(lane == 8, tl.sum(tl.sum(w * g[2], axis=0), axis=0), totals)
    totals = tl.where(lane == 9, tl.sum(tl.sum(tl.abs(s), axis=0), axis=0), totals)
    return tl.where(lane == 10, tl.max(tl.max(w, axis=0), axis=0), totals)


@triton.jit(do_not_specialize=["stride", "across", "height", "width", "t_min"])
def composite_backward(
    rows, stride, start, chunk_start, slot, background, t_min, across, height, width,
    stored, chunks, grad_image, grad_remaining, slots, CHUNK: tl.constexpr,
):  # fmt: skip
    """Gradients of `composite`, summed into slots float32 [pairs, SLOT], which hold zeros.

    Arguments as there; grad_image [H, W, 3] and grad_remaining [H, W]: d loss / d (image, remaining).
    """
    tile = tl.program_id(0)
    column, row = places()
    x, y = column.to(tl.float32), row.to(tl.float32)
    image_x, image_y = tile % across * WIDE + column, tile // across * HIGH + row
    inside = (image_x < width) & (image_y < height)
    at = image_y.to(tl.int64) * width + image_x
    red = tl.load(grad_image + 3 * at, mask=inside, other=0.0)
    green = tl.load(grad_image + 3 * at + 1, mask=inside, other=0.0)
    blue = tl.load(grad_image + 3 * at + 2, mask=inside, other=0.0)
    behind = tl.load(grad_remaining + at, mask=inside, other=0.0)
    behind += red * tl.load(background) + green * tl.load(background + 1) + blue * tl.load(background + 2)
    begin, stop = tl.load(start + tile), tl.load(start + tile + 1)
    keep = stored + tl.load(chunk_start + tile) * PIXELS + row * WIDE + column
    lane = tl.arange(0, 32)
    chunk = tl.load(chunks + tile) - 1
    while chunk >= 0:
        first = begin + chunk * CHUNK
        light = tl.load(keep + chunk.to(tl.int64) * PIXELS)
        lights, alphas = _walk(rows, stride, first, stop, x, y, light, t_min, CHUNK)
        for j in tl.static_range(CHUNK - 1, -1, -1):
            w = alphas[j] * lights[j]
            present = first + j < stop
            colour = read_colour(rows, stride, first + j, stop)
            d = tl.fma(red, colour[0], tl.fma(green, colour[1], tl.fma(blue, colour[2], -behind)))
            behind = tl.fma(alphas[j], d, behind)
            to = slots + tl.load(slot + (first + j), mask=present, other=0) * SLOT + lane
            totals = _totals(w * d, w, (red, green, blue))
            tl.store(to, totals, mask=lane < tl.where(present, SLOT, 0))
        chunk -= 1

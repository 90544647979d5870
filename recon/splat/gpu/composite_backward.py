# mypy: allow-untyped-defs, allow-incomplete-defs, allow-untyped-calls, allow-untyped-decorators
"""The gradient of `composite`: each tile's list back to front, without dividing by 1 - alpha.

With g = d loss / d pixel, w = alpha T and B = what lies behind a layer, blended, dotted with g:
`d loss / d alpha = T (colour . g - B)`, and in front of that layer `B + alpha (colour . g - B)`.
T comes from the stored transmittances, multiplied forward through a chunk; with alpha it stays in registers.
Every entry has its own slot of sums, so that no sum depends on which program ran when. As in the forward
pass, one warp does a tile: its sums need neither shared memory nor a barrier.

Places count in whitened coordinates (y1, y2) from the mean (see `tiles.gather`): at pixels that an ellipse
touches they are a few, however long it is, so that float32 has digits enough for their squares.
"""

import triton
import triton.language as tl

from recon.splat.gpu.composite import PIXELS, cover, places, read_colour, read_ellipse, read_place
from recon.splat.gpu.inputs import appended
from recon.splat.gpu.project import HIGH, WIDE

SLOT = tl.constexpr(11)
"""Floats of a slot: with s = alpha d loss / d alpha at a pixel and (y1, y2) its whitened place, the sums of
s, s y1, s y2, s y1 y1, s y1 y2, s y2 y2, then of w g (3) and of |s|, then the largest w."""


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
def _merged(a, b, bit: tl.constexpr):
    """Sums over pairs of lanes that differ in a bit: of a where it is not set, of b where it is."""
    lane = tl.arange(0, 32)
    upper = (lane & bit) != 0
    return tl.where(upper, b, a) + tl.gather(tl.where(upper, a, b), lane ^ bit, 0)


@triton.jit
def _doubled(a, bit: tl.constexpr):
    """Sums over pairs of lanes that differ in a bit, in both."""
    return a + tl.gather(a, tl.arange(0, 32) ^ bit, 0)


@triton.jit
def _totals(s, w, g, place):
    """A slot's floats, in lanes: s, w [4, 32] at the pixels, g their gradients; place: from `read_place`.

    The ten sums are added up together: with each exchange of lanes half as many are under way, so that lane k
    ends with the k-th after 12 exchanges instead of 50.
    """
    y1, y2, m11, m21, m22 = place
    lane = tl.arange(0, 32)
    x, y, step = (lane & 15).to(tl.float32), (lane >> 4).to(tl.float32), (2 * tl.arange(0, 4)).to(tl.float32)
    # A lane's pixels share y1, since they share x.
    y1 = tl.fma(x, m11, y1)
    y2 = tl.fma(step[:, None], m22, tl.fma(y, m22, tl.fma(x, m21, y2))[None, :])
    e = _merged(tl.sum(w * g[2], axis=0), tl.sum(tl.abs(s), axis=0), 1)
    totals = _doubled(_doubled(e, 2), 4)
    cd = _merged(tl.sum(w * g[0], axis=0), tl.sum(w * g[1], axis=0), 1)
    peak = tl.max(tl.max(w, axis=0), axis=0)
    m0, m1 = tl.sum(s, axis=0), tl.sum(s * y2, axis=0)
    cd = _merged(_merged(m1 * y1, tl.sum(s * y2 * y2, axis=0), 1), cd, 2)
    sy1 = m0 * y1
    ab = _merged(_merged(m0, sy1, 1), _merged(m1, sy1 * y1, 1), 2)
    totals = _doubled(_merged(_merged(ab, cd, 4), totals, 8), 16)
    return tl.where(lane == 10, peak, totals)


# Were `stored` known to be aligned, its loads would be of four floats each and all pixels laid out for them,
# and the sums would take seven times the exchanges between lanes: 4,368 instructions a chunk of 8 for 2,616.
@triton.jit(
    do_not_specialize=["stride", "across", "height", "width", "t_min"],
    do_not_specialize_on_alignment=["stored"],
)
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
    states = stored + tl.load(chunk_start + tile) * PIXELS
    lane = tl.arange(0, 32)
    chunk = tl.load(chunks + tile) - 1
    while chunk >= 0:
        first = begin + chunk * CHUNK
        # In a scalar, to save the registers of a pointer for each pixel.
        light = tl.load(
            states + chunk.to(tl.int64) * PIXELS + (lane[None, :] + 32 * tl.arange(0, 4)[:, None])
        )
        lights, alphas = _walk(rows, stride, first, stop, x, y, light, t_min, CHUNK)
        for j in tl.static_range(CHUNK - 1, -1, -1):
            w = alphas[j] * lights[j]
            present = first + j < stop
            colour = read_colour(rows, stride, first + j, stop)
            d = tl.fma(red, colour[0], tl.fma(green, colour[1], tl.fma(blue, colour[2], -behind)))
            behind = tl.fma(alphas[j], d, behind)
            to = slots + tl.load(slot + (first + j), mask=present, other=0) * SLOT + lane
            totals = _totals(w * d, w, (red, green, blue), read_place(rows, stride, first + j))
            tl.store(to, totals, mask=lane < tl.where(present, SLOT, 0))
        chunk -= 1

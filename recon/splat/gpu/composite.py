# mypy: allow-untyped-defs, allow-incomplete-defs, allow-untyped-calls, allow-untyped-decorators
"""Blending the entries of a tile front to back: one warp a tile, its pixels in registers.

The threads walk the list together, four pixels each, and exchange nothing but, once a chunk, the largest
transmittance: no shared memory, no barrier. Before each chunk the transmittances are stored, so that
the backward pass can start anywhere without a division. float32, with places counted from the tile's origin
(see `tiles.gather`).
"""

import triton
import triton.language as tl

from recon.splat.gpu.project import HIGH, WIDE

PIXELS = tl.constexpr(WIDE.value * HIGH.value)
_ROUND = tl.constexpr(12582912.0)
"""1.5 x 2^23: a float32 this large holds whole numbers only, and those in its lowest bits."""
# 2^f = 1 + f P(f) for |f| <= 1/2, the numbers of `recon.splat.cpu.composite`.
P0 = tl.constexpr(0.6931471228599548)
P1 = tl.constexpr(0.24022351205348969)
P2 = tl.constexpr(0.05550500378012657)
P3 = tl.constexpr(0.009666245430707932)
P4 = tl.constexpr(0.0013333539245650172)


@triton.jit
def places():
    """The pixels of a tile as [4, 32], two rows in one: column [1, 32] and row [4, 32] in the tile."""
    lane, pair = tl.arange(0, 32)[None, :], tl.arange(0, 4)[:, None]
    return lane & 15, 2 * pair + (lane >> 4)


@triton.jit
def read_place(rows, stride, entry):
    """An entry's whitened coordinates at the tile's first pixel, and m11, m21, m22."""
    at = rows + entry
    return (
        tl.load(at),
        tl.load(at + stride),
        tl.load(at + 2 * stride),
        tl.load(at + 3 * stride),
        tl.load(at + 4 * stride),
    )


@triton.jit
def read_ellipse(rows, stride, entry, stop):
    """An entry's numbers for `cover`; beyond the list's end those of one that touches nothing."""
    reach = tl.load(rows + entry + 5 * stride, mask=entry < stop, other=1.0)
    opacity = tl.load(rows + entry + 6 * stride)
    return read_place(rows, stride, entry) + (reach, opacity)  # noqa: RUF005  Triton does not know the star


@triton.jit
def read_colour(rows, stride, entry, stop):
    """An entry's red, green and blue; black beyond the list's end."""
    at, present = rows + entry, entry < stop
    return (
        tl.load(at + 7 * stride, mask=present, other=0.0),
        tl.load(at + 8 * stride, mask=present, other=0.0),
        tl.load(at + 9 * stride, mask=present, other=0.0),
    )


@triton.jit
def cover(ellipse, x, y, light, t_min):
    """(touched, alpha, 1 - alpha) of an entry at pixels (x, y) of the tile with transmittance `light`.

    alpha = opacity 2^t, t = -(y1^2 + y2^2), as s (1 + f P(f)) with s = opacity 2^round(t): so 1 - alpha
    = (1 - s) - s f P(f) loses no digits where alpha is near 1. Where not touched both are garbage, but
    finite.
    """
    y1, y2, m11, m21, m22, reach, opacity = ellipse
    y1 = tl.fma(x, m11, y1)
    y2 = tl.fma(y, m22, tl.fma(x, m21, y2))
    t = tl.fma(-y2, y2, -(y1 * y1))
    touched = (t >= reach) & (light >= t_min)
    t = tl.maximum(t, reach)
    # Rounded without a conversion, of which the hardware does few: the sum's low bits go to the exponent.
    whole = t + _ROUND
    f = t - (whole - _ROUND)
    s = opacity.to(tl.int32, bitcast=True) + (whole.to(tl.int32, bitcast=True) << 23)
    s = s.to(tl.float32, bitcast=True)
    p = tl.fma(tl.fma(tl.fma(tl.fma(f, P4, P3), f, P2), f, P1), f, P0)
    part = s * f
    return touched, tl.fma(part, p, s), tl.fma(-part, p, 1.0 - s)


@triton.jit(do_not_specialize=["stride", "across", "height", "width", "t_min"])
def composite(
    rows, stride, start, chunk_start, background, t_min, across, height, width,
    stored, image, remaining, pairs, chunks, CHUNK: tl.constexpr, KEEP: tl.constexpr,
):  # fmt: skip
    """Render tiles: image [H, W, 3], remaining transmittance [H, W], per tile pairs and chunks walked.

    stored: float32 [all chunks * PIXELS], transmittances for the backward pass, if KEEP.
    """
    tile = tl.program_id(0)
    column, row = places()
    x, y = column.to(tl.float32), row.to(tl.float32)
    image_x, image_y = tile % across * WIDE + column, tile // across * HIGH + row
    inside = (image_x < width) & (image_y < height)
    # Pixels outside the image count as finished.
    light = tl.where(inside, 1.0, 0.0)
    red, green, blue = tl.zeros_like(light), tl.zeros_like(light), tl.zeros_like(light)
    begin, stop = tl.load(start + tile), tl.load(start + tile + 1)
    keep = stored + tl.load(chunk_start + tile) * PIXELS + row * WIDE + column
    entry, walked, most = begin, 0, tl.max(light)
    while (entry < stop) & (most >= t_min):
        if KEEP:
            tl.store(keep + (entry - begin) * (PIXELS // CHUNK), light)
        for j in tl.static_range(CHUNK):
            ellipse = read_ellipse(rows, stride, entry + j, stop)
            colour = read_colour(rows, stride, entry + j, stop)
            touched, alpha, through = cover(ellipse, x, y, light, t_min)
            w = tl.where(touched, alpha * light, 0.0)
            light = tl.where(touched, light * through, light)
            red = tl.fma(w, colour[0], red)
            green = tl.fma(w, colour[1], green)
            blue = tl.fma(w, colour[2], blue)
        most = tl.max(light)
        entry += CHUNK
        walked += 1
    tl.store(chunks + tile, walked)
    # As on the CPU, blocks of 8x8 that hold a pixel of the image are counted whole.
    blocks = (tl.minimum(width - tile % across * WIDE, WIDE) + 7) // 8
    tl.store(pairs + tile, (tl.minimum(entry, stop) - begin) * (blocks * 64))
    at = image_y.to(tl.int64) * width + image_x
    tl.store(remaining + at, light, mask=inside)
    tl.store(image + 3 * at, tl.fma(light, tl.load(background), red), mask=inside)
    tl.store(image + 3 * at + 1, tl.fma(light, tl.load(background + 1), green), mask=inside)
    tl.store(image + 3 * at + 2, tl.fma(light, tl.load(background + 2), blue), mask=inside)

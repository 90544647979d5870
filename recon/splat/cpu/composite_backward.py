# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""The gradient of `composite`: each tile's lists back to front, without dividing by 1 - alpha.

With g = d loss / d pixel, w = alpha T and B = what lies behind a layer, blended, dotted with g:
`d loss / d alpha = T (colour . g - B)`, and in front of that layer `B + alpha (colour . g - B)`.
T comes from the stored transmittances, multiplied forward through a chunk and stored beside alpha.
Every (tile, Gaussian) entry has its own slot of sums; a Gaussian's slots are added up afterwards in
their order. No sum depends on which thread did what, so gradients are equal to the last bit.
"""

import numpy as np

from imaging.compute.jit import inlined, kernel
from imaging.compute.threads import take_number
from recon.splat.cpu.composite import CHUNK, FIELDS, PIXELS, block_pixel, cover, gather, select, whitened
from recon.splat.cpu.lanes import (
    WIDTH,
    absolute,
    choose,
    dot_each,
    fma,
    lane_column,
    lane_row,
    largest,
    load,
    load_each,
    maximum,
    plus_each,
    splat,
    store,
    store_each,
    times_each,
    totals,
)
from recon.splat.cpu.tiles import TILE

MOMENTS = 6
"""Sums that a slot begins with: with s = alpha d loss / d alpha at a pixel and (x, y) its place from the
tile's centre, of s, s x, s y, s x x, s x y, s y y. Then it has those of w g for each channel, the sum of |s|,
and the largest w."""
_ZERO = np.float32(0.0)
_HALF_TILE = np.float32(TILE / 2 - 0.5)


def slot_size(channels: int) -> int:
    """Floats of a slot: whole vectors of four."""
    return -(-(MOMENTS + channels + 2) // 4) * 4


_slot_size = inlined(slot_size)


@inlined
def _lanes_size(channels):
    """Floats of a slot while a tile adds to it: whole lanes."""
    return -(-(MOMENTS + channels + 2) // WIDTH) * WIDTH


@inlined
def _walk(q, y2, light, rows, at, t_min, alphas, lights, place):
    """Forward over one vector: store alpha (0 where not touched) and the transmittance before it."""
    touched, alpha, through = cover(q, y2, light, splat(rows[at + 6]), splat(rows[at + 5]), t_min)
    alpha = choose(touched, alpha, _ZERO)
    store(alphas, place, alpha)
    store(lights, place, light)
    return choose(touched, light * through, light), alpha * light


@inlined
def _walk_block(rows, chosen, count, block, t_min, background, light, at_light, alphas, lights, slots):
    """Forward over a block from the stored transmittances; largest weights go to the slots.

    Leaves in `chosen` only the Gaussians that touched a pixel here, and returns how many.
    """
    touched = 0
    t0, t1 = load(light, at_light), load(light, at_light + 16)
    t2, t3 = load(light, at_light + 32), load(light, at_light + 48)
    for n in range(count):
        at = chosen[n] * (FIELDS + len(background))
        q, y2, step = whitened(rows, at, block)
        p = 64 * touched
        t0, w0 = _walk(q, y2, t0, rows, at, t_min, alphas, lights, p)
        y2 = y2 + step
        t1, w1 = _walk(q, y2, t1, rows, at, t_min, alphas, lights, p + 16)
        y2 = y2 + step
        t2, w2 = _walk(q, y2, t2, rows, at, t_min, alphas, lights, p + 32)
        y2 = y2 + step
        t3, w3 = _walk(q, y2, t3, rows, at, t_min, alphas, lights, p + 48)
        peak = largest(maximum(maximum(w0, w1), maximum(w2, w3)))
        slot = chosen[n] * _lanes_size(len(background)) + MOMENTS + len(background) + 1
        slots[slot] = max(slots[slot], peak)
        chosen[touched] = chosen[n]
        touched += peak > _ZERO
    return touched


@inlined
def _return(rows, at, alphas, lights, place, pixel, background, grads, behind):
    """Backward over one vector: (s, the new B, w g for each channel)."""
    alpha = load(alphas, place)
    w = alpha * load(lights, place)
    g = load_each(grads, pixel, PIXELS, background)
    d = dot_each(g, rows, at + FIELDS, splat(_ZERO) - behind)
    return w * d, fma(alpha, d, behind), times_each(w, g)


@inlined
def _return_block(rows, chosen, count, block, background, alphas, lights, grads, behind, slots):
    """Backward over a block: adds to the slots of the chosen Gaussians, moves B in front of them."""
    p = 64 * block
    b0, b1 = load(behind, p), load(behind, p + 16)
    b2, b3 = load(behind, p + 32), load(behind, p + 48)
    x = lane_column() + splat(np.float32(8 * (block & 1)) - _HALF_TILE)
    y = lane_row() + splat(np.float32(8 * (block >> 1)) - _HALF_TILE)
    for n in range(count - 1, -1, -1):
        at = chosen[n] * (FIELDS + len(background))
        a = 64 * n
        s0, b0, light = _return(rows, at, alphas, lights, a, p, background, grads, b0)
        s1, b1, more = _return(rows, at, alphas, lights, a + 16, p + 16, background, grads, b1)
        light = plus_each(light, more)
        s2, b2, more = _return(rows, at, alphas, lights, a + 32, p + 32, background, grads, b2)
        light = plus_each(light, more)
        s3, b3, more = _return(rows, at, alphas, lights, a + 48, p + 48, background, grads, b3)
        light = plus_each(light, more)
        # Vector v holds rows 2 v and 2 v + 1: y = y(vector 0) + 2 v, so sums weighted by 2 v and 4 v^2.
        m0 = (s0 + s1) + (s2 + s3)
        m1 = fma(s3, np.float32(6.0), fma(s2, np.float32(4.0), s1 * np.float32(2.0)))
        m2 = fma(s3, np.float32(36.0), fma(s2, np.float32(16.0), s1 * np.float32(4.0)))
        sx = m0 * x
        sy = fma(m0, y, m1)
        syy = fma(y, sy, fma(y, m1, m2))
        strength = (absolute(s0) + absolute(s1)) + (absolute(s2) + absolute(s3))
        sums = totals((m0, sx, sy, sx * x, sy * x, syy) + light + (strength,))  # noqa: RUF005  Numba does not know the star
        slot = chosen[n] * _lanes_size(len(background))
        store_each(slots, slot, WIDTH, plus_each(load_each(slots, slot, WIDTH, sums), sums))
    store(behind, p, b0)
    store(behind, p + 16, b1)
    store(behind, p + 32, b2)
    store(behind, p + 48, b3)


@inlined
def _tile_gradients(tile_x, tile_y, grad_image, grad_remaining, background, grads, behind):
    """Gather a tile's d loss / d pixel, block by block, and B behind its last Gaussian."""
    height, width = grad_remaining.shape
    for p in range(len(grads)):
        grads[p] = _ZERO
    for p in range(PIXELS):
        behind[p] = _ZERO
    for y in range(tile_y * TILE, min((tile_y + 1) * TILE, height)):
        for x in range(tile_x * TILE, min((tile_x + 1) * TILE, width)):
            p = block_pixel(x & 15, y & 15)
            back = _ZERO
            for c in range(len(background)):
                grads[c * PIXELS + p] = grad_image[y, x, c]
                back += grad_image[y, x, c] * background[c]
            behind[p] = back + grad_remaining[y, x]


@kernel
def composite_backward(
    counter, lists, projected, background, t_min, stored, chunks, grad_image, grad_remaining, slots
):
    """Gradients of `composite`, summed per entry into slots float32 [entries * slot_size(C)].

    Arguments as there; grad_image [H, W, C] and grad_remaining [H, W]: d loss / d (image, remaining).
    """
    size, room = _slot_size(len(background)), _lanes_size(len(background))
    rows = np.empty(CHUNK * (FIELDS + len(background)), np.float32)
    bits = np.empty(CHUNK, np.intp)
    chosen = np.empty(CHUNK + 1, np.intp)
    alphas = np.empty(CHUNK * 64, np.float32)
    lights = np.empty(CHUNK * 64, np.float32)
    grads = np.empty(len(background) * PIXELS, np.float32)
    behind = np.empty(PIXELS, np.float32)
    sums = np.empty(CHUNK * room, np.float32)
    floor = splat(t_min)
    tile = take_number(counter)
    while tile < len(chunks):
        tile_x, tile_y = tile % lists.across, tile // lists.across
        start, stop = lists.start[tile], lists.start[tile + 1]
        if chunks[tile]:
            _tile_gradients(tile_x, tile_y, grad_image, grad_remaining, background, grads, behind)
        for chunk in range(chunks[tile] - 1, -1, -1):
            begin = start + chunk * CHUNK
            end = min(begin + CHUNK, stop)
            gather(lists, projected, background, begin, end, tile_x, tile_y, bits, rows)
            for j in range(0, (end - begin) * room, WIDTH):
                store(sums, j, splat(_ZERO))
            for block in range(4):
                at = (lists.chunk_start[tile] + chunk) * PIXELS + 64 * block
                if _most(stored, at) >= t_min:
                    count = select(bits, end - begin, block, chosen)
                    count = _walk_block(
                        rows, chosen, count, block, floor, background, stored, at, alphas, lights, sums
                    )
                    _return_block(rows, chosen, count, block, background, alphas, lights, grads, behind, sums)
            for j in range(end - begin):
                slot = size * np.intp(lists.slot[begin + j])
                for k in range(size):
                    slots[slot + k] = sums[room * j + k]
        for j in range(min(start + chunks[tile] * CHUNK, stop), stop):
            slot = size * np.intp(lists.slot[j])
            for k in range(size):
                slots[slot + k] = _ZERO
        tile = take_number(counter)


@inlined
def _most(light, at):
    """The largest transmittance of a block."""
    a = maximum(load(light, at), load(light, at + 16))
    return largest(maximum(a, maximum(load(light, at + 32), load(light, at + 48))))

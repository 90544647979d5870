# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""Blending the Gaussians of a tile front to back, sixteen pixels at a time.

A vector is two rows of eight pixels of an 8x8 block, so four vectors are a block and their transmittance
and colour stay in registers while the block's list is walked. Lists are walked in chunks; before each
chunk the transmittances are stored, so that the backward pass can start anywhere without a division.

`background` is a tuple with a number for each channel of light: how many there are is part of its type, and
the compiler makes a kernel for each number that is used.
"""

import numpy as np

from imaging.compute.jit import inlined, kernel
from imaging.compute.threads import take_number
from recon.splat.cpu.lanes import (
    WIDTH,
    at_least,
    both,
    choose,
    fma,
    fma_each,
    lane_column,
    lane_row,
    largest,
    load,
    load_each,
    maximum,
    minus,
    round_bits,
    rounded,
    scale_by,
    splat,
    store,
    store_each,
)
from recon.splat.cpu.tiles import ID_BITS, TILE
from recon.splat.tables import PAINT

CHUNK = 64
"""Gaussians walked between two stored transmittances."""
FIELDS = 7
"""Floats of a Gaussian in a tile before its colours: see `gather`."""
PIXELS = TILE * TILE
_ID_MASK = np.uint32((1 << ID_BITS) - 1)
_BITS = np.uint32(ID_BITS)
_ONE = np.float32(1.0)
_ZERO = np.float32(0.0)
_TWO = np.float32(2.0)
# 2^f = 1 + f P(f) for |f| <= 1/2, largest relative error 1.7e-7 (Remez fit of P, relative).
_P0 = np.float32(0.6931471228599548)
_P1 = np.float32(0.24022351205348969)
_P2 = np.float32(0.05550500378012657)
_P3 = np.float32(0.009666245430707932)
_P4 = np.float32(0.0013333539245650172)


@inlined
def gather(lists, projected, background, begin, end, tile_x, tile_y, bits, rows):
    """Copy what a tile needs of entries begin..end to rows float32 [CHUNK * (FIELDS + channels)].

    Fields: y1, y2 (m11 dx and m21 dx + m22 dy at the tile's first pixel, subtracted in float64),
    m11, m21, m22, -reach, opacity, colours. bits int64 [CHUNK]: the block bits.
    """
    shape, paint = projected.shape, projected.paint
    x0 = tile_x * TILE + 0.5
    y0 = tile_y * TILE + 0.5
    for j in range(end - begin):
        entry = lists.id[begin + j]
        i = np.intp(entry & _ID_MASK)
        bits[j] = np.intp(entry >> _BITS)
        at = j * (FIELDS + len(background))
        dx, dy = x0 - shape[i, 0], y0 - shape[i, 1]
        rows[at] = shape[i, 2] * dx
        rows[at + 1] = shape[i, 3] * dx + shape[i, 4] * dy
        rows[at + 2] = shape[i, 2]
        rows[at + 3] = shape[i, 3]
        rows[at + 4] = shape[i, 4]
        rows[at + 5] = paint[i, PAINT]
        rows[at + 6] = paint[i, PAINT + 1]
        for c in range(len(background)):
            rows[at + FIELDS + c] = paint[i, PAINT + 2 + c]


@inlined
def select(bits, count, block, chosen):
    """Indices of the chunk's Gaussians that touch a block, without a branch; returns how many."""
    n = 0
    for j in range(count):
        chosen[n] = j
        n += (bits[j] >> block) & 1
    return n


@inlined
def whitened(rows, at, block):
    """-y1^2 and y2 of the first two rows of a block, and the step of y2 to the next two."""
    m11, m21, m22 = rows[at + 2], rows[at + 3], rows[at + 4]
    x = np.float32(8 * (block & 1))
    y = np.float32(8 * (block >> 1))
    y1 = fma(lane_column(), m11, splat(rows[at] + x * m11))
    y2 = fma(lane_column(), m21, splat((rows[at + 1] + x * m21) + y * m22))
    y2 = fma(lane_row(), m22, y2)
    return minus(y1 * y1), y2, splat(_TWO * m22)


@inlined
def cover(quadratic, y2, light, opacity, reach, t_min):
    """(touched, alpha, 1 - alpha) of a Gaussian at sixteen pixels with transmittance `light`.

    alpha = opacity 2^t, t = -(y1^2 + y2^2), as s (1 + f P(f)) with s = opacity 2^round(t): so 1 - alpha
    = (1 - s) - s f P(f) loses no digits where alpha is near 1. Where not touched both are garbage.
    """
    t = fma(minus(y2), y2, quadratic)
    bits = round_bits(t)
    f = t - rounded(bits)
    s = scale_by(opacity, bits)
    p = fma(fma(fma(fma(splat(_P4), f, _P3), f, _P2), f, _P1), f, _P0)
    part = s * f
    touched = both(at_least(t, reach), at_least(light, t_min))
    return touched, fma(part, p, s), fma(minus(part), p, splat(_ONE) - s)


@inlined
def _blend(q, y2, t, colour, rows, at, t_min):
    """One Gaussian over one vector: the new transmittance and colour."""
    touched, alpha, through = cover(q, y2, t, splat(rows[at + 6]), splat(rows[at + 5]), t_min)
    w = choose(touched, alpha * t, _ZERO)
    t = choose(touched, t * through, t)
    return t, fma_each(w, rows, at + FIELDS, colour)


@inlined
def _blend_block(rows, chosen, count, block, t_min, background, state):
    """Blend the chosen Gaussians over a block; returns the largest transmittance left.

    state float32 [(1 + channels) * PIXELS]: planes of transmittance and channels, a block's 64 pixels
    contiguous.
    """
    p = 64 * block
    t0, t1, t2, t3 = load(state, p), load(state, p + 16), load(state, p + 32), load(state, p + 48)
    p += PIXELS
    c0 = load_each(state, p, PIXELS, background)
    c1 = load_each(state, p + 16, PIXELS, background)
    c2 = load_each(state, p + 32, PIXELS, background)
    c3 = load_each(state, p + 48, PIXELS, background)
    for n in range(count):
        at = chosen[n] * (FIELDS + len(background))
        q, y2, step = whitened(rows, at, block)
        t0, c0 = _blend(q, y2, t0, c0, rows, at, t_min)
        y2 = y2 + step
        t1, c1 = _blend(q, y2, t1, c1, rows, at, t_min)
        y2 = y2 + step
        t2, c2 = _blend(q, y2, t2, c2, rows, at, t_min)
        y2 = y2 + step
        t3, c3 = _blend(q, y2, t3, c3, rows, at, t_min)
    p = 64 * block
    store(state, p, t0)
    store(state, p + 16, t1)
    store(state, p + 32, t2)
    store(state, p + 48, t3)
    p += PIXELS
    store_each(state, p, PIXELS, c0)
    store_each(state, p + 16, PIXELS, c1)
    store_each(state, p + 32, PIXELS, c2)
    store_each(state, p + 48, PIXELS, c3)
    return largest(maximum(maximum(t0, t1), maximum(t2, t3)))


@inlined
def block_pixel(x, y):
    """Index of pixel (x, y) of a tile in its block-wise planes."""
    return ((y >> 3) * 2 + (x >> 3)) * 64 + (y & 7) * 8 + (x & 7)


@inlined
def _begin(tile_x, tile_y, height, width, state, alive):
    """Reset the blending; pixels outside the image count as finished."""
    for p in range(len(state)):
        state[p] = _ZERO
    for block in range(4):
        alive[block] = 0
    for y in range(min(TILE, height - tile_y * TILE)):
        for x in range(min(TILE, width - tile_x * TILE)):
            p = block_pixel(x, y)
            state[p] = _ONE
            alive[p >> 6] = 1


@inlined
def _finish(tile_x, tile_y, background, state, image, remaining):
    """Write a tile's pixels, over the background."""
    height, width = remaining.shape
    for y in range(tile_y * TILE, min((tile_y + 1) * TILE, height)):
        for x in range(tile_x * TILE, min((tile_x + 1) * TILE, width)):
            p = block_pixel(x & 15, y & 15)
            t = state[p]
            remaining[y, x] = t
            for c in range(len(background)):
                image[y, x, c] = state[(1 + c) * PIXELS + p] + t * background[c]


@kernel
def composite(counter, lists, projected, background, t_min, stored, image, remaining, pairs, chunks):
    """Render tiles: image [H, W, C], remaining transmittance [H, W], per tile pairs and chunks walked.

    stored: float32 [all chunks * PIXELS], transmittances for the backward pass; or empty.
    """
    rows = np.empty(CHUNK * (FIELDS + len(background)), np.float32)
    bits = np.empty(CHUNK, np.intp)
    chosen = np.empty(CHUNK + 1, np.intp)
    state = np.empty((1 + len(background)) * PIXELS, np.float32)
    alive = np.empty(4, np.intp)
    floor = splat(t_min)
    height, width = remaining.shape
    tile = take_number(counter)
    while tile < len(pairs):
        tile_x, tile_y = tile % lists.across, tile // lists.across
        _begin(tile_x, tile_y, height, width, state, alive)
        pairs[tile] = chunks[tile] = 0
        begin, stop = lists.start[tile], lists.start[tile + 1]
        while begin < stop and alive[0] + alive[1] + alive[2] + alive[3] > 0:
            end = min(begin + CHUNK, stop)
            gather(lists, projected, background, begin, end, tile_x, tile_y, bits, rows)
            if len(stored):
                at = (lists.chunk_start[tile] + chunks[tile]) * PIXELS
                for p in range(0, PIXELS, WIDTH):
                    store(stored, at + p, load(state, p))
            for block in range(4):
                if alive[block]:
                    count = select(bits, end - begin, block, chosen)
                    if count:
                        most = _blend_block(rows, chosen, count, block, floor, background, state)
                        alive[block] = most >= t_min
                        pairs[tile] += 64 * count
            chunks[tile] += 1
            begin = end
        _finish(tile_x, tile_y, background, state, image, remaining)
        tile = take_number(counter)

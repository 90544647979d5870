# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""Which Gaussians touch which tile, nearest first: a depth sort, then a stable counting sort by tile.

A tile is 16x16 pixels in four blocks of 8x8. A Gaussian is listed in a tile when its ellipse reaches a
pixel centre's row within a block's columns; a bit per block says which blocks.
"""

import math

import numba
import numpy as np

from recon.jit import kernel, parallel_kernel

TILE = 16
ID_BITS = 28
"""A list entry is the Gaussian's index, and above these bits its four block bits."""
MAX_GAUSSIANS = 1 << ID_BITS
_SLACK = 1e-9
"""The ellipse is widened by this fraction, so that rounding never drops a pixel that it touches."""


@kernel
def depth_order(depth, state):
    """Indices of the drawn Gaussians, nearest first, ties in order of index: int32 [V].

    Stable radix sort, three passes of 11 bits, on the bits of the positive float32 depths.
    """
    bits = depth.view(np.uint32)
    count = 0
    for i in range(len(state)):
        count += state[i] == 1
    order, other = np.empty(count, np.int32), np.empty(count, np.int32)
    keys, other_keys = np.empty(count, np.uint32), np.empty(count, np.uint32)
    histogram = np.zeros((3, 2048), np.int64)
    n = 0
    for i in range(len(state)):
        if state[i] == 1:
            key = np.int64(bits[i])
            order[n], keys[n] = i, bits[i]
            n += 1
            histogram[0, key & 2047] += 1
            histogram[1, (key >> 11) & 2047] += 1
            histogram[2, key >> 22] += 1
    for step in range(3):
        shift = 11 * step
        start = np.int64(0)
        for digit in range(2048):
            size = histogram[step, digit]
            histogram[step, digit] = start
            start += size
        for j in range(count):
            digit = (np.int64(keys[j]) >> shift) & 2047
            place = histogram[step, digit]
            histogram[step, digit] += 1
            other[place], other_keys[place] = order[j], keys[j]
        order, other = other, order
        keys, other_keys = other_keys, keys
    return order


@kernel
def _rows(low_x, high_x, m11, m21, m22, reach):
    """(lowest, highest) dy of the ellipse over dx in [low_x, high_x]; (1, 0) where there is none.

    The upper edge is dy(dx) = (-m21 dx + sqrt(reach - (m11 dx)^2)) / m22, concave, so its largest value
    on an interval is at the interval's point nearest to the top of the ellipse; the lower edge mirrors it.
    """
    half = math.sqrt(reach) / m11
    low_x, high_x = max(low_x, -half), min(high_x, half)
    if low_x > high_x:
        return 1.0, 0.0
    top = -half * m21 / math.sqrt(m11 * m11 + m21 * m21)
    x = min(max(top, low_x), high_x)
    high = (-m21 * x + math.sqrt(max(reach - (m11 * x) * (m11 * x), 0.0))) / m22
    x = min(max(-top, low_x), high_x)
    low = (-m21 * x - math.sqrt(max(reach - (m11 * x) * (m11 * x), 0.0))) / m22
    return low, high


@kernel
def _block_rows(column, px, py, m11, m21, m22, reach, first_row, last_row):
    """First and last row of blocks that the ellipse reaches in a column of blocks; (1, 0) for none."""
    left = 8 * column + 0.5 - px
    low, high = _rows(left, left + 7.0, m11, m21, m22, reach)
    if low > high:
        return 1, 0
    first = math.ceil(max(py + low - 0.5, float(first_row)))
    last = math.floor(min(py + high - 0.5, float(last_row)))
    if first > last:
        return 1, 0
    return int(first) >> 3, int(last) >> 3


@kernel
def _emit_one(shape, box, tiles_x, tile, bits):
    """Write the tiles and block bits of one Gaussian; returns how many."""
    px, py, m11, m21, m22 = shape[0], shape[1], shape[2], shape[3], shape[4]
    reach = shape[5] * (1.0 + _SLACK) + _SLACK
    n = 0
    for tx in range(box[0] >> 4, (box[1] >> 4) + 1):
        a0, a1 = _block_rows(2 * tx, px, py, m11, m21, m22, reach, box[2], box[3])
        b0, b1 = _block_rows(2 * tx + 1, px, py, m11, m21, m22, reach, box[2], box[3])
        if a0 > a1 and b0 > b1:
            continue
        first = min(a0, b0) if a0 <= a1 and b0 <= b1 else (a0 if a0 <= a1 else b0)
        last = max(a1, b1) if a0 <= a1 and b0 <= b1 else (a1 if a0 <= a1 else b1)
        for ty in range(first >> 1, (last >> 1) + 1):
            upper, lower = 2 * ty, 2 * ty + 1
            mask = (a0 <= upper) & (upper <= a1)
            mask += 2 * ((b0 <= upper) & (upper <= b1))
            mask += 4 * ((a0 <= lower) & (lower <= a1))
            mask += 8 * ((b0 <= lower) & (lower <= b1))
            if mask:
                tile[n] = ty * tiles_x + tx
                bits[n] = mask
                n += 1
    return n


@kernel
def capacities(box, state, start):
    """start int64 [N + 1]: where each Gaussian's entries may begin, from the tiles of its bounding box."""
    total = 0
    for i in range(len(state)):
        start[i] = total
        if state[i] == 1:
            across = (box[i, 1] >> 4) - (box[i, 0] >> 4) + 1
            total += across * ((box[i, 3] >> 4) - (box[i, 2] >> 4) + 1)
    start[len(state)] = total
    return total


@parallel_kernel
def emit(shape, box, state, start, tiles_x, tile, bits, count):
    """Entries of every Gaussian i at start[i]: tile int32, block bits uint8; count int32 [N] of them."""
    for i in numba.prange(len(state)):
        count[i] = 0
        if state[i] == 1:
            here, end = start[i], start[i + 1]
            count[i] = _emit_one(shape[i], box[i], tiles_x, tile[here:end], bits[here:end])


@kernel
def slot_starts(count, slot):
    """slot int64 [N + 1]: the first gradient slot of each Gaussian; returns the number of entries."""
    total = 0
    for i in range(len(count)):
        slot[i] = total
        total += count[i]
    slot[len(count)] = total
    return total


@parallel_kernel
def scatter(order, start, count, slot, tile, bits, parts, cursor, tile_start, list_id, list_slot):
    """Sort the entries by tile, nearest first within a tile.

    order: Gaussians by depth, cut in `parts` contiguous parts, each with its own row of counts in
    cursor int64 [parts, tiles]; the result does not depend on `parts`. Out: tile_start int64 [tiles + 1],
    list_id uint32 (index and block bits) and list_slot int32, [entries].
    """
    tiles = cursor.shape[1]
    size = (len(order) + parts - 1) // parts
    for part in numba.prange(parts):
        cursor[part, :] = 0
        for j in range(part * size, min((part + 1) * size, len(order))):
            i = order[j]
            for e in range(start[i], start[i] + count[i]):
                cursor[part, tile[e]] += 1
    total = 0
    for t in range(tiles):
        tile_start[t] = total
        for part in range(parts):
            here = cursor[part, t]
            cursor[part, t] = total
            total += here
    tile_start[tiles] = total
    for part in numba.prange(parts):
        for j in range(part * size, min((part + 1) * size, len(order))):
            i = order[j]
            for n in range(count[i]):
                t = tile[start[i] + n]
                place = cursor[part, t]
                cursor[part, t] = place + 1
                list_id[place] = np.uint32(i) | (np.uint32(bits[start[i] + n]) << np.uint32(ID_BITS))
                list_slot[place] = slot[i] + n

# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""Which Gaussians touch which tile, nearest first: a depth sort, then a stable counting sort by tile.

A tile is 16x16 pixels in four blocks of 8x8. A Gaussian is listed in a tile when its ellipse reaches a
pixel centre's row within a block's columns; a bit per block says which blocks.
"""

import math

import numpy as np

from recon.jit import kernel
from recon.splat.tables import DRAWN
from recon.threads import take_number

TILE = 16
ID_BITS = 28
"""A list entry is the Gaussian's index, and above these bits its four block bits."""
MAX_GAUSSIANS = 1 << ID_BITS
TASK = 1024
"""Gaussians that a thread takes at a time."""
_SLACK = 1e-9
"""The ellipse is widened by this fraction, so that rounding never drops a pixel that it touches."""


@kernel
def depth_order(bits, state):
    """Indices of the drawn Gaussians, nearest first, ties in order of index: int32 [V].

    Stable radix sort, three passes of 11 bits, on bits uint32 [N] of the positive float32 depths.
    """
    drawn = 0
    for i in range(len(state)):
        drawn += state[i] == DRAWN
    order, other = np.empty(drawn, np.int32), np.empty(drawn, np.int32)
    keys, other_keys = np.empty(drawn, np.uint32), np.empty(drawn, np.uint32)
    histogram = np.zeros((3, 2048), np.int64)
    n = 0
    for i in range(len(state)):
        if state[i] == DRAWN:
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
        for j in range(drawn):
            place = histogram[step, (np.int64(keys[j]) >> shift) & 2047]
            histogram[step, (np.int64(keys[j]) >> shift) & 2047] += 1
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
        if state[i] == DRAWN:
            across = (box[i, 1] >> 4) - (box[i, 0] >> 4) + 1
            total += across * ((box[i, 3] >> 4) - (box[i, 2] >> 4) + 1)
    start[len(state)] = total
    return total


@kernel
def emit(counter, projected, across, entries):
    """Write the entries (tile, bits, count) of every Gaussian."""
    n = len(projected.state)
    task = take_number(counter)
    while task * TASK < n:
        for i in range(task * TASK, min((task + 1) * TASK, n)):
            entries.number[i] = 0
            if projected.state[i] == DRAWN:
                here, end = entries.start[i], entries.start[i + 1]
                entries.number[i] = _emit_one(
                    projected.shape[i],
                    projected.box[i],
                    across,
                    entries.tile[here:end],
                    entries.bits[here:end],
                )
        task = take_number(counter)


@kernel
def number_slots(number, slot):
    """Fill slot int64 [N + 1]; returns the number of entries."""
    total = 0
    for i in range(len(number)):
        slot[i] = total
        total += number[i]
    slot[len(number)] = total
    return total


@kernel
def count_entries(counter, order, entries, cursor):
    """cursor int64 [parts, tiles]: entries per tile, of each of `parts` contiguous parts of `order`."""
    parts, tiles = cursor.shape
    size = (len(order) + parts - 1) // parts
    part = take_number(counter)
    while part < parts:
        for t in range(tiles):
            cursor[part, t] = 0
        for j in range(part * size, min((part + 1) * size, len(order))):
            here = entries.start[order[j]]
            for e in range(here, here + entries.number[order[j]]):
                cursor[part, entries.tile[e]] += 1
        part = take_number(counter)


@kernel
def place_parts(cursor, tile_start):
    """Turn the counts into places: tile after tile, and in a tile part after part; fills tile_start."""
    parts, tiles = cursor.shape
    total = 0
    for t in range(tiles):
        tile_start[t] = total
        for part in range(parts):
            size = cursor[part, t]
            cursor[part, t] = total
            total += size
    tile_start[tiles] = total


@kernel
def scatter(counter, order, entries, cursor, lists):
    """Sort the entries by tile, nearest first within a tile: lists.id, lists.slot; the same for any parts."""
    parts = len(cursor)
    size = (len(order) + parts - 1) // parts
    part = take_number(counter)
    while part < parts:
        for j in range(part * size, min((part + 1) * size, len(order))):
            i = order[j]
            here, slot = entries.start[i], entries.slot[i]
            for n in range(entries.number[i]):
                t = entries.tile[here + n]
                place = cursor[part, t]
                cursor[part, t] = place + 1
                lists.id[place] = np.uint32(i) | (np.uint32(entries.bits[here + n]) << np.uint32(ID_BITS))
                lists.slot[place] = slot + n
        part = take_number(counter)

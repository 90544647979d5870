# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""Which Gaussians touch which tile, nearest first: a depth sort, then a stable counting sort by tile.

A tile is 16x16 pixels in four blocks of 8x8. A Gaussian is listed in a tile when its ellipse reaches a
pixel centre's row within a block's columns; a bit per block says which blocks.
"""

import math

import numpy as np

from recon.jit import kernel
from recon.lanes import (
    at_least,
    both,
    ceiling,
    choose,
    floor,
    lane_number,
    maximum,
    minimum,
    root,
    splat,
    store,
)
from recon.splat.tables import DRAWN, PAINT
from recon.threads import take_number

TILE = 16
ID_BITS = 28
"""A list entry is the Gaussian's index, and above these bits its four block bits."""
MAX_GAUSSIANS = 1 << ID_BITS
TASK = 1024
"""Gaussians that a thread takes at a time."""
_SLACK = 1e-6
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
def _column_blocks(column, edges, first_row, last_row, out):
    """First and last row of blocks that an ellipse reaches, in eight columns of blocks from `column` on.

    out float64 [16]: the eight first, then the eight last; first above last where there is none.
    The ellipse is cut to pixel centres: a column is an interval of dx from its first to its last pixel.
    The upper edge is dy(dx) = slope dx + sqrt(reach - (m11 dx)^2) / m22, concave, so its largest value on
    an interval is at the interval's point nearest to the top of the ellipse; the lower edge mirrors it.
    """
    px, py, m11, inverse, slope, reach, half, top = edges
    left = lane_number() * 8.0 + (8.0 * column + 0.5 - px)
    low_x, high_x = maximum(left, -half), minimum(left + 7.0, half)
    x = minimum(maximum(splat(top), low_x), high_x)
    y = root(maximum(reach - (x * m11) * (x * m11), 0.0)) * inverse + x * slope
    last = floor(minimum(y + (py - 0.5), last_row))
    x = minimum(maximum(splat(-top), low_x), high_x)
    y = x * slope - root(maximum(reach - (x * m11) * (x * m11), 0.0)) * inverse
    first = ceiling(maximum(y + (py - 0.5), first_row))
    reached = both(at_least(high_x, low_x), at_least(last, first))
    store(out, 0, choose(reached, floor(first * 0.125), 1e9))
    store(out, 8, choose(reached, floor(last * 0.125), -1.0))


@kernel
def _emit_one(shape, paint, box, i, across, tile, bits, begin, blocks):
    """Write the tiles and block bits of Gaussian i from index `begin` on; returns how many.

    blocks float64 [16]: scratch. One element more than the result may be written to tile and bits.
    """
    px, py, m11, m21, m22 = shape[i, 0], shape[i, 1], shape[i, 2], shape[i, 3], shape[i, 4]
    reach = _SLACK - (1.0 + _SLACK) * paint[i, PAINT]
    half = math.sqrt(reach) / m11
    top = -half * m21 / math.sqrt(m11 * m11 + m21 * m21)
    inverse = 1.0 / m22
    edges = (px, py, m11, inverse, -m21 * inverse, reach, half, top)
    first_row, last_row = np.float64(box[i, 2]), np.float64(box[i, 3])
    first_tile, last_tile = box[i, 0] >> 4, box[i, 1] >> 4
    n = begin
    for start in range(first_tile, last_tile + 1, 4):
        _column_blocks(np.float64(2 * start), edges, first_row, last_row, blocks)
        for t in range(min(4, last_tile + 1 - start)):
            a0, b0 = int(blocks[2 * t]), int(blocks[2 * t + 1])
            a1, b1 = int(blocks[8 + 2 * t]), int(blocks[9 + 2 * t])
            for row in range(min(a0, b0) >> 1, (max(a1, b1) >> 1) + 1):
                upper, lower = 2 * row, 2 * row + 1
                mask = (
                    ((a0 <= upper) & (upper <= a1))
                    + 2 * ((b0 <= upper) & (upper <= b1))
                    + 4 * ((a0 <= lower) & (lower <= a1))
                    + 8 * ((b0 <= lower) & (lower <= b1))
                )
                # Written in any case and kept if there is a block: cheaper than a branch.
                tile[n] = row * across + start + t
                bits[n] = mask
                n += mask != 0
    return n - begin


@kernel
def capacities(box, state, start):
    """start int64 [N + 1]: where each Gaussian's entries may begin, from the tiles of its bounding box."""
    total = 0
    for i in range(len(state)):
        start[i] = total
        if state[i] == DRAWN:
            across = (box[i, 1] >> 4) - (box[i, 0] >> 4) + 1
            total += across * ((box[i, 3] >> 4) - (box[i, 2] >> 4) + 1) + 1
    start[len(state)] = total
    return total


@kernel
def emit(counter, projected, across, entries):
    """Write the entries (tile, bits, count) of every Gaussian."""
    n = len(projected.state)
    blocks = np.empty(16)
    task = take_number(counter)
    while task * TASK < n:
        for i in range(task * TASK, min((task + 1) * TASK, n)):
            entries.number[i] = 0
            if projected.state[i] == DRAWN:
                entries.number[i] = _emit_one(
                    projected.shape, projected.paint, projected.box, i, across,
                    entries.tile, entries.bits, entries.start[i], blocks,
                )  # fmt: skip
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

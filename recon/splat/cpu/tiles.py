# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""Assignment of Gaussians to tiles, nearest first: a depth sort, then a stable counting sort by tile.

A tile is 16x16 pixels in four blocks of 8x8. A Gaussian is listed in a tile when its ellipse reaches a
pixel centre's row within a block's columns; a bit per block says which blocks.
"""

import math

import numpy as np

from imaging.compute.jit import inlined, kernel
from imaging.compute.threads import take_number
from recon.splat.cpu.lanes import (
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

TILE = 16
ID_BITS = 28
"""A list entry is the Gaussian's index, and above these bits its four block bits."""
MAX_GAUSSIANS = 1 << ID_BITS
TASK = 1024
"""Gaussians that a thread takes at a time."""
_BATCH = 64
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


@inlined
def _column_blocks(projected, i, first_tile, out, at):
    """First and last row of blocks that Gaussian i reaches, in the eight columns of blocks of four tiles.

    out float64 [at : at + 16]: the eight first, then the eight last; first above last for an empty column.
    The ellipse is cut to pixel centres: a column is an interval of dx from its first to its last pixel.
    The upper edge is dy(dx) = (-m21 dx + sqrt(reach - (m11 dx)^2)) / m22, concave, so its largest value on
    an interval is at the interval's point nearest to the top of the ellipse; the lower edge mirrors it.
    """
    shape, box = projected.shape, projected.box
    px, py, m11, m21 = shape[i, 0], shape[i, 1], shape[i, 2], shape[i, 3]
    reach = _SLACK - (1.0 + _SLACK) * projected.paint[i, PAINT]
    half = math.sqrt(reach) / m11
    top = -half * m21 / math.sqrt(m11 * m11 + m21 * m21)
    inverse = 1.0 / shape[i, 4]
    slope = -m21 * inverse
    left = lane_number() * 8.0 + (16.0 * first_tile + 0.5 - px)
    low_x, high_x = maximum(left, -half), minimum(left + 7.0, half)
    x = minimum(maximum(splat(top), low_x), high_x)
    y = root(maximum(reach - (x * m11) * (x * m11), 0.0)) * inverse + x * slope
    last = floor(minimum(y + (py - 0.5), np.float64(box[i, 3])))
    x = minimum(maximum(splat(-top), low_x), high_x)
    y = x * slope - root(maximum(reach - (x * m11) * (x * m11), 0.0)) * inverse
    first = ceiling(maximum(y + (py - 0.5), np.float64(box[i, 2])))
    reached = both(at_least(high_x, low_x), at_least(last, first))
    store(out, at, choose(reached, floor(first * 0.125), 1e9))
    store(out, at + 8, choose(reached, floor(last * 0.125), -1.0))


@inlined
def _emit_tiles(blocks, at, first_tile, count, across, tile, bits, n):
    """Write the entries of `count` (at most 4) tile columns from index n on; returns the next index.

    One element more may be written to tile and bits.
    """
    for t in range(count):
        a0, b0 = int(blocks[at + 2 * t]), int(blocks[at + 2 * t + 1])
        a1, b1 = int(blocks[at + 8 + 2 * t]), int(blocks[at + 9 + 2 * t])
        for row in range(min(a0, b0) >> 1, (max(a1, b1) >> 1) + 1):
            upper, lower = 2 * row, 2 * row + 1
            mask = (
                ((a0 <= upper) & (upper <= a1))
                + 2 * ((b0 <= upper) & (upper <= b1))
                + 4 * ((a0 <= lower) & (lower <= a1))
                + 8 * ((b0 <= lower) & (lower <= b1))
            )
            # Written in any case and kept if there is a block: cheaper than a branch.
            tile[n] = row * across + first_tile + t
            bits[n] = mask
            n += mask != 0
    return n


@inlined
def _emit_batch(projected, across, entries, first, count, blocks):
    """Entries of Gaussians first .. first + count - 1. blocks float64 [16 * count]: scratch.

    All ellipses are cut before the first is listed: listing branches on what was cut, and a branch that
    the processor guessed wrong would throw away its work on the next ellipses.
    """
    box = projected.box
    for j in range(count):
        if projected.state[first + j] == DRAWN:
            _column_blocks(projected, first + j, np.float64(box[first + j, 0] >> 4), blocks, 16 * j)
    for j in range(count):
        i = first + j
        entries.number[i] = 0
        if projected.state[i] == DRAWN:
            begin, tile, last_tile = entries.start[i], box[i, 0] >> 4, box[i, 1] >> 4
            end = _emit_tiles(
                blocks, 16 * j, tile, min(4, last_tile + 1 - tile), across, entries.tile, entries.bits, begin
            )
            for more in range(tile + 4, last_tile + 1, 4):
                _column_blocks(projected, i, np.float64(more), blocks, 16 * j)
                columns = min(4, last_tile + 1 - more)
                end = _emit_tiles(blocks, 16 * j, more, columns, across, entries.tile, entries.bits, end)
            entries.number[i] = end - begin


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
    """Write the entries (tile, bits, number) of every Gaussian."""
    n = len(projected.state)
    blocks = np.empty(16 * _BATCH)
    task = take_number(counter)
    while task * TASK < n:
        stop = min((task + 1) * TASK, n)
        for first in range(task * TASK, stop, _BATCH):
            _emit_batch(projected, across, entries, first, min(_BATCH, stop - first), blocks)
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

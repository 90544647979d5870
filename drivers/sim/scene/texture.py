"""Albedo of a surface point in closed form: lattice noise shaped into plaster, tiles, wood, bricks.

Every texture is a function of the point's place in its solid, in metres, so it sticks to the solid
and has no seams. Lattice values come from an integer hash: nothing repeats. The finest cells are
several pixels wide in the demo views, which leaves little to alias under 4x4 samples a pixel.
"""

import math
from typing import Any

import numpy as np

from imaging.compute.jit import compiled

MOTTLE, TILES, SPOTS, WOOD, BRICKS = range(5)

MATERIAL = np.dtype(
    [
        ("pattern", np.int64),
        ("seed", np.int64),
        ("cell", np.float64, 3),  # m, size of a cell along each axis
        ("edge", np.float64),  # width of the blend between cells, 1 = smooth noise
        ("warp", np.float64),  # cells that the pattern is bent by slow noise
        ("detail", np.float64),  # relative depth of the fine mottling on top
        ("colours", np.float64, (3, 3)),  # albedo, linear Rec.709
        ("gloss", np.float64),  # reflectance of the highlight at its peak angle
        ("sharpness", np.float64),  # Blinn-Phong exponent
        ("emission", np.float64, 3),  # radiance of a lamp, linear Rec.709
    ]
)

_X, _Y, _Z, _SEED = (
    np.uint64(value)
    for value in (0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9, 0xD6E8FEB86659FD93)
)
_MIX = np.uint64(0xBF58476D1CE4E5B9)
_SHIFT, _DROP = np.uint64(31), np.uint64(11)


@compiled
def unit_hash(x: int, y: int, z: int, seed: int) -> float:
    """A number in [0, 1) that depends on the four integers and looks random."""
    h = np.uint64(x) * _X + np.uint64(y) * _Y + np.uint64(z) * _Z + np.uint64(seed) * _SEED
    h = (h ^ (h >> _SHIFT)) * _MIX
    h = (h ^ (h >> _SHIFT)) * _X
    h = h ^ (h >> _SHIFT)
    return float(h >> _DROP) * 2.0**-53


@compiled
def _blend(fraction: float, edge: float) -> float:
    step = min(max((fraction - 0.5) / edge + 0.5, 0.0), 1.0)
    return step * step * step * (step * (step * 6.0 - 15.0) + 10.0)


@compiled
def noise(x: float, y: float, z: float, seed: int, edge: float) -> float:
    """Value noise in [0, 1], cells of size 1; `edge` 1 is smooth, near 0 gives flat tiles."""
    i, j, k = math.floor(x), math.floor(y), math.floor(z)
    u, v, w = _blend(x - i, edge), _blend(y - j, edge), _blend(z - k, edge)
    total = 0.0
    for di in range(2):
        a = u if di else 1.0 - u
        if a == 0.0:
            continue
        for dj in range(2):
            b = a * (v if dj else 1.0 - v)
            if b == 0.0:
                continue
            for dk in range(2):
                c = b * (w if dk else 1.0 - w)
                if c != 0.0:
                    total += c * unit_hash(i + di, j + dj, k + dk, seed)
    return total


@compiled
def _smoothstep(low: float, high: float, x: float) -> float:
    t = min(max((x - low) / (high - low), 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t)


@compiled
def _spot(x: float, y: float, z: float, seed: int) -> tuple[float, float]:
    """Return how much of a spot the point is in (0..1), and the spot's own random number.

    A spot is a ball that lies whole within its cell, so no neighbour has to be asked.
    """
    i, j, k = math.floor(x), math.floor(y), math.floor(z)
    radius = 0.26 + 0.2 * unit_hash(i, j, k, seed)
    room = 1.0 - 2.0 * radius
    dx = x - i - radius - room * unit_hash(i, j, k, seed + 1)
    dy = y - j - radius - room * unit_hash(i, j, k, seed + 2)
    dz = z - k - radius - room * unit_hash(i, j, k, seed + 3)
    distance = math.sqrt(dx * dx + dy * dy + dz * dz) / radius
    return 1.0 - _smoothstep(0.75, 1.0, distance), unit_hash(i, j, k, seed + 4)


@compiled
def _palette(colours: np.ndarray, value: float, channel: int) -> float:
    """Colours 0, 1, 2 at the values 0, 1/2, 1, linear between."""
    first = 0 if value < 0.5 else 1
    low: float = colours[first, channel]
    high: float = colours[first + 1, channel]
    return low + (high - low) * (2.0 * value - first)


@compiled
def albedo(material: Any, solid: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Reflectance at a point of the solid of that index, linear Rec.709, each 0..1."""
    # No two solids of a material look alike.
    seed = material.seed + 100 * solid
    # The offsets keep faces such as z = 0 away from the lattice planes.
    px = x / material.cell[0] + 16.0 * unit_hash(1, 0, 0, seed)
    py = y / material.cell[1] + 16.0 * unit_hash(0, 1, 0, seed)
    pz = z / material.cell[2] + 16.0 * unit_hash(0, 0, 1, seed)
    if material.warp > 0.0:
        bend = noise(px * 0.5, py * 0.5, pz * 0.5, seed + 11, 1.0) - 0.5
        px += material.warp * bend
        pz -= material.warp * bend
    if material.pattern == WOOD:
        # Planks along y, each with its own tone and its own grain.
        plank = math.floor(px)
        tone = unit_hash(plank, 0, math.floor(pz), seed)
        grain = noise(px * 5.0, py + 7.0 * tone, pz * 5.0, seed + 5, 1.0)
        value = 0.55 * tone + 0.45 * grain
    elif material.pattern == BRICKS:
        # Courses along y, each shifted against the next; every brick has its own tone.
        course = math.floor(pz)
        along = py + 0.5 * (course % 2) + 0.2 * unit_hash(0, 0, course, seed + 3)
        brick = math.floor(along)
        side = min(along - brick, 1.0 - along + brick) * material.cell[1] / material.cell[2]
        joint = 1.0 - _smoothstep(0.0, 2.0 * material.edge, min(side, pz - course, 1.0 - pz + course))
        value = joint + (1.0 - joint) * 0.6 * unit_hash(0, brick, course, seed)
    elif material.pattern == SPOTS:
        inside, brightness = _spot(px, py, pz, seed)
        value = (1.0 - inside) * 0.25 * noise(px, py, pz, seed + 7, 1.0) + inside * (0.4 + 0.6 * brightness)
    else:
        value = noise(px, py, pz, seed, material.edge)
        value = min(max(1.6 * (value - 0.5) + 0.5, 0.0), 1.0)
    fine = noise(px * 2.3 + 5.1, py * 2.3, pz * 2.3, seed + 13, 1.0)
    factor = 1.0 + material.detail * (2.0 * fine - 1.0)
    return (
        _palette(material.colours, value, 0) * factor,
        _palette(material.colours, value, 1) * factor,
        _palette(material.colours, value, 2) * factor,
    )

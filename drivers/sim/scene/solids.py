"""Spheres, upright cylinders, boxes turned about the vertical, and such a room around them all.

Where a ray meets them, which way the surface faces there and how far away it is, in float64.
"""

import math
from typing import Any

import numpy as np

from imaging.compute.jit import compiled

SPHERE, BOX, CYLINDER, ROOM = range(4)

SOLID = np.dtype(
    [
        ("kind", np.int64),
        ("material", np.int64),  # of a room the first of six: low and high x, y, z
        ("blocks", np.int64),  # 1: casts shadows; walls and lamps do not
        ("cx", np.float64),  # centre, m
        ("cy", np.float64),
        ("cz", np.float64),
        ("hx", np.float64),  # half extents, m; hx is the radius of a sphere or a cylinder
        ("hy", np.float64),
        ("hz", np.float64),
        ("cos", np.float64),  # turn about the vertical, local from world
        ("sin", np.float64),
        ("bound", np.float64),  # radius of the bounding sphere, m
    ]
)

EPSILON = 1e-9
Triple = tuple[float, float, float]


@compiled
def _slab(origin: float, direction: float, half: float) -> tuple[float, float]:
    """Return where a ray enters and leaves |x| <= half, along one axis."""
    if abs(direction) < 1e-300:
        return (-math.inf, math.inf) if abs(origin) <= half else (math.inf, -math.inf)
    a, b = (-half - origin) / direction, (half - origin) / direction
    return (a, b) if a < b else (b, a)


@compiled
def _round(ox: float, oy: float, oz: float, dx: float, dy: float, dz: float, r: float) -> tuple[float, float]:
    """Return where a ray enters and leaves a ball (or, without z, a disc) of radius r about the origin."""
    a = dx * dx + dy * dy + dz * dz
    if a < 1e-300:
        inside = ox * ox + oy * oy + oz * oz <= r * r
        return (-math.inf, math.inf) if inside else (math.inf, -math.inf)
    b = ox * dx + oy * dy + oz * dz
    # The distance from the nearest point keeps its digits for far origins, c - b^2/a does not.
    s = b / a
    nx, ny, nz = ox - s * dx, oy - s * dy, oz - s * dz
    gap = r * r - (nx * nx + ny * ny + nz * nz)
    if gap < 0.0:
        return math.inf, -math.inf
    root = math.sqrt(gap / a)
    return -s - root, -s + root


@compiled
def hit(solid: Any, ox: float, oy: float, oz: float, dx: float, dy: float, dz: float) -> float:
    """Distance, in lengths of the direction, to the first surface of a solid ahead; inf if none."""
    x, y, z = ox - solid.cx, oy - solid.cy, oz - solid.cz
    if solid.kind == SPHERE:
        near, far = _round(x, y, z, dx, dy, dz, solid.hx)
    elif solid.kind == ROOM:
        # From inside only: along each axis the wall that the ray runs towards.
        lx, ly = solid.cos * x + solid.sin * y, solid.cos * y - solid.sin * x
        ex, ey = solid.cos * dx + solid.sin * dy, solid.cos * dy - solid.sin * dx
        tx = (math.copysign(solid.hx, ex) - lx) / ex if ex != 0.0 else math.inf
        ty = (math.copysign(solid.hy, ey) - ly) / ey if ey != 0.0 else math.inf
        tz = (math.copysign(solid.hz, dz) - z) / dz if dz != 0.0 else math.inf
        return min(tx, ty, tz)
    elif solid.kind == BOX:
        lx, ly = solid.cos * x + solid.sin * y, solid.cos * y - solid.sin * x
        ex, ey = solid.cos * dx + solid.sin * dy, solid.cos * dy - solid.sin * dx
        near, far = _slab(z, dz, solid.hz)
        a, b = _slab(lx, ex, solid.hx)
        near, far = max(near, a), min(far, b)
        if near > far:
            return math.inf
        a, b = _slab(ly, ey, solid.hy)
        near, far = max(near, a), min(far, b)
    else:
        near, far = _round(x, y, 0.0, dx, dy, 0.0, solid.hx)
        a, b = _slab(z, dz, solid.hz)
        near, far = max(near, a), min(far, b)
    if near > far or far <= EPSILON:
        return math.inf
    return near if near > EPSILON else far


@compiled
def near_line(
    solid: Any, ox: float, oy: float, oz: float, dx: float, dy: float, dz: float, reach: float
) -> bool:
    """Return whether a unit ray comes near a solid's bounding sphere before `reach`: a cheap first test."""
    x, y, z = solid.cx - ox, solid.cy - oy, solid.cz - oz
    along = x * dx + y * dy + z * dz
    r = solid.bound
    if along < -r or along > reach + r:
        return False
    return bool(x * x + y * y + z * z - along * along <= r * r)


@compiled
def local(solid: Any, x: float, y: float, z: float) -> Triple:
    """A world point in the solid's own axes."""
    x, y, z = x - solid.cx, y - solid.cy, z - solid.cz
    return solid.cos * x + solid.sin * y, solid.cos * y - solid.sin * x, z


@compiled
def normal(solid: Any, x: float, y: float, z: float) -> Triple:
    """Outward unit normal at a world point on the surface."""
    lx, ly, lz = local(solid, x, y, z)
    if solid.kind == SPHERE:
        return (x - solid.cx) / solid.hx, (y - solid.cy) / solid.hx, lz / solid.hx
    if solid.kind == CYLINDER:
        radius = math.sqrt(lx * lx + ly * ly)
        if abs(abs(lz) - solid.hz) < abs(radius - solid.hx):
            return 0.0, 0.0, math.copysign(1.0, lz)
        return (x - solid.cx) / radius, (y - solid.cy) / radius, 0.0
    gx, gy, gz = abs(abs(lx) - solid.hx), abs(abs(ly) - solid.hy), abs(abs(lz) - solid.hz)
    if gz <= gx and gz <= gy:
        return 0.0, 0.0, math.copysign(1.0, lz)
    if gx <= gy:
        side = math.copysign(1.0, lx)
        return solid.cos * side, solid.sin * side, 0.0
    side = math.copysign(1.0, ly)
    return -solid.sin * side, solid.cos * side, 0.0


@compiled
def material_at(solid: Any, lx: float, ly: float, lz: float) -> int:
    """Index of the material at a local point on the surface."""
    first = int(solid.material)
    if solid.kind != ROOM:
        return first
    gx, gy, gz = solid.hx - abs(lx), solid.hy - abs(ly), solid.hz - abs(lz)
    if gz <= gx and gz <= gy:
        return first + 4 + (lz > 0.0)
    return first + (lx > 0.0) if gx <= gy else first + 2 + (ly > 0.0)


@compiled
def distance(solid: Any, x: float, y: float, z: float) -> float:
    """Distance from a world point to the solid, m; zero or less inside (of a room: outside)."""
    lx, ly, lz = local(solid, x, y, z)
    if solid.kind == SPHERE:
        return math.sqrt(lx * lx + ly * ly + lz * lz) - float(solid.hx)
    if solid.kind == ROOM:
        return float(min(solid.hx - abs(lx), solid.hy - abs(ly), solid.hz - abs(lz)))
    if solid.kind == CYLINDER:
        gx, gy, gz = math.sqrt(lx * lx + ly * ly) - solid.hx, -1.0, abs(lz) - solid.hz
    else:
        gx, gy, gz = abs(lx) - solid.hx, abs(ly) - solid.hy, abs(lz) - solid.hz
    ax: float = max(gx, 0.0)
    ay: float = max(gy, 0.0)
    az: float = max(gz, 0.0)
    return math.sqrt(ax * ax + ay * ay + az * az)

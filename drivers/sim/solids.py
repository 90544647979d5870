"""Spheres, boxes turned about the vertical, and upright cylinders: where a ray meets them, in float64."""

import math
from typing import Any

import numpy as np

from drivers.sim.compiling import compiled

SPHERE, BOX, CYLINDER = range(3)

SOLID = np.dtype(
    [
        ("kind", np.int64),
        ("material", np.int64),
        ("blocks", np.int64),  # 1: casts shadows; walls and lamps do not
        ("centre", np.float64, 3),
        ("half", np.float64, 3),  # half extents, m; a sphere's radius is half[0], a cylinder's too
        ("cos", np.float64),  # turn about the vertical, local from world
        ("sin", np.float64),
        ("bound", np.float64),  # radius of the bounding sphere, m
    ]
)

EPSILON = 1e-9
Triple = tuple[float, float, float]


@compiled
def _slab(origin: float, direction: float, half: float) -> tuple[float, float]:
    """Where a ray enters and leaves |x| <= half, along one axis."""
    if abs(direction) < 1e-300:
        return (-math.inf, math.inf) if abs(origin) <= half else (math.inf, -math.inf)
    a, b = (-half - origin) / direction, (half - origin) / direction
    return (a, b) if a < b else (b, a)


@compiled
def _round(ox: float, oy: float, oz: float, dx: float, dy: float, dz: float, r: float) -> tuple[float, float]:
    """Where a ray enters and leaves a ball (or, without z, a disc) of radius r about the origin."""
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
    x, y, z = ox - solid.centre[0], oy - solid.centre[1], oz - solid.centre[2]
    half = solid.half
    if solid.kind == SPHERE:
        near, far = _round(x, y, z, dx, dy, dz, half[0])
    elif solid.kind == BOX:
        lx, ly = solid.cos * x + solid.sin * y, solid.cos * y - solid.sin * x
        ex, ey = solid.cos * dx + solid.sin * dy, solid.cos * dy - solid.sin * dx
        near, far = _slab(lx, ex, half[0])
        a, b = _slab(ly, ey, half[1])
        near, far = max(near, a), min(far, b)
        a, b = _slab(z, dz, half[2])
        near, far = max(near, a), min(far, b)
    else:
        near, far = _round(x, y, 0.0, dx, dy, 0.0, half[0])
        a, b = _slab(z, dz, half[2])
        near, far = max(near, a), min(far, b)
    if near > far or far <= EPSILON:
        return math.inf
    return near if near > EPSILON else far


@compiled
def near_line(
    solid: Any, ox: float, oy: float, oz: float, dx: float, dy: float, dz: float, reach: float
) -> bool:
    """Whether a unit ray comes near a solid's bounding sphere before `reach`: a cheap first test."""
    x, y, z = solid.centre[0] - ox, solid.centre[1] - oy, solid.centre[2] - oz
    along = x * dx + y * dy + z * dz
    r: float = solid.bound
    if along < -r or along > reach + r:
        return False
    return x * x + y * y + z * z - along * along <= r * r


@compiled
def local(solid: Any, x: float, y: float, z: float) -> Triple:
    """A world point in the solid's own axes."""
    x, y, z = x - solid.centre[0], y - solid.centre[1], z - solid.centre[2]
    return solid.cos * x + solid.sin * y, solid.cos * y - solid.sin * x, z


@compiled
def normal(solid: Any, x: float, y: float, z: float) -> Triple:
    """Outward unit normal at a world point on the surface."""
    lx, ly, lz = local(solid, x, y, z)
    half = solid.half
    if solid.kind == SPHERE:
        return (x - solid.centre[0]) / half[0], (y - solid.centre[1]) / half[0], lz / half[0]
    if solid.kind == CYLINDER:
        radius = math.sqrt(lx * lx + ly * ly)
        if abs(abs(lz) - half[2]) < abs(radius - half[0]):
            return 0.0, 0.0, math.copysign(1.0, lz)
        return (x - solid.centre[0]) / radius, (y - solid.centre[1]) / radius, 0.0
    gx, gy, gz = abs(abs(lx) - half[0]), abs(abs(ly) - half[1]), abs(abs(lz) - half[2])
    if gz <= gx and gz <= gy:
        return 0.0, 0.0, math.copysign(1.0, lz)
    if gx <= gy:
        side = math.copysign(1.0, lx)
        return solid.cos * side, solid.sin * side, 0.0
    side = math.copysign(1.0, ly)
    return -solid.sin * side, solid.cos * side, 0.0


@compiled
def distance(solid: Any, x: float, y: float, z: float) -> float:
    """Distance from a world point to the solid, m; zero or less inside."""
    lx, ly, lz = local(solid, x, y, z)
    half = solid.half
    if solid.kind == SPHERE:
        return math.sqrt(lx * lx + ly * ly + lz * lz) - half[0]
    if solid.kind == CYLINDER:
        gx, gy, gz = math.sqrt(lx * lx + ly * ly) - half[0], -1.0, abs(lz) - half[2]
    else:
        gx, gy, gz = abs(lx) - half[0], abs(ly) - half[1], abs(lz) - half[2]
    ax: float = max(gx, 0.0)
    ay: float = max(gy, 0.0)
    az: float = max(gz, 0.0)
    return math.sqrt(ax * ax + ay * ay + az * az)

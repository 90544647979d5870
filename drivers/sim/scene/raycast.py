"""Radiance along a ray: nearest solid, then emission, ambient light and shadowed point lights."""

import math
from typing import Any

import numpy as np

from drivers.sim.camera.lens import ray
from drivers.sim.scene.solids import EPSILON, Triple, distance, hit, local, material_at, near_line, normal
from drivers.sim.scene.texture import albedo
from imaging.compute.jit import compiled

LIGHT = np.dtype(
    [
        ("place", np.float64, 3),
        ("intensity", np.float64, 3),  # radiant intensity, linear Rec.709
        ("radius", np.float64),  # of the lamp around the point: shadow rays stop at its surface
    ]
)

DIM_ZONE = np.dtype(
    [
        ("centre", np.float64, 3),
        ("half", np.float64, 3),
        ("cos", np.float64),
        ("sin", np.float64),
        ("sides", np.int64, 3),  # per axis: 1 open at the low end, 2 at the high end, 3 at both
        ("reach", np.float64),  # m behind an opening at which the zone is darkest
        ("stops", np.float64),  # how much darker that is
    ]
)


@compiled
def nearest(
    solids: np.ndarray, ox: float, oy: float, oz: float, dx: float, dy: float, dz: float
) -> tuple[int, float]:
    """Index of the solid that a unit ray meets first, and the distance; (-1, inf) if none."""
    nearest, best = -1, math.inf
    for index in range(solids.shape[0]):
        solid = solids[index]
        if near_line(solid, ox, oy, oz, dx, dy, dz, best):
            t = hit(solid, ox, oy, oz, dx, dy, dz)
            if t < best:
                nearest, best = index, t
    return nearest, best


@compiled
def shadowed(
    solids: np.ndarray, x: float, y: float, z: float, dx: float, dy: float, dz: float, reach: float
) -> bool:
    """Return whether anything that blocks light lies within `reach` along a unit ray."""
    for index in range(solids.shape[0]):
        solid = solids[index]
        if solid.blocks and near_line(solid, x, y, z, dx, dy, dz, reach):
            t = hit(solid, x, y, z, dx, dy, dz)
            if t < reach:
                return True
    return False


@compiled
def _dimming(zone: Any, x: float, y: float, z: float) -> float:
    """Factor on the ambient light at a point of a half-closed space, from its depth behind the openings."""
    x, y, z = x - zone.centre[0], y - zone.centre[1], z - zone.centre[2]
    place = (zone.cos * x + zone.sin * y, zone.cos * y - zone.sin * x, z)
    depth = math.inf
    for axis in range(3):
        low, high = place[axis] + zone.half[axis], zone.half[axis] - place[axis]
        if low < 0.0 or high < 0.0:
            return 1.0
        if zone.sides[axis] & 1:
            depth = min(depth, low)
        if zone.sides[axis] & 2:
            depth = min(depth, high)
    t = min(depth / zone.reach, 1.0)
    return math.exp2(-zone.stops * t * t * (3.0 - 2.0 * t))


@compiled
def _openness(solids: np.ndarray, x: float, y: float, z: float, n: Triple) -> float:
    """Return how much of the room a point sees, 0..1, from distances a little way out along its normal."""
    near, far = 0.06, 0.25
    gap_near, gap_far = near, far
    for index in range(solids.shape[0]):
        solid = solids[index]
        ax, ay, az = x - solid.cx, y - solid.cy, z - solid.cz
        reach = solid.bound + 2.0 * far
        if ax * ax + ay * ay + az * az < reach * reach:
            gap_far = min(gap_far, distance(solid, x + far * n[0], y + far * n[1], z + far * n[2]))
            gap_near = min(gap_near, distance(solid, x + near * n[0], y + near * n[1], z + near * n[2]))
    return (0.5 + 0.5 * max(gap_near, 0.0) / near) * (0.5 + 0.5 * max(gap_far, 0.0) / far)


@compiled
def radiance_of_ray(
    solids: np.ndarray,
    materials: np.ndarray,
    lights: np.ndarray,
    zones: np.ndarray,
    ambient: np.ndarray,
    ox: float,
    oy: float,
    oz: float,
    dx: float,
    dy: float,
    dz: float,
) -> tuple[float, float, float]:
    """Radiance that comes back along a unit ray, linear Rec.709; black if it meets nothing."""
    index, t = nearest(solids, ox, oy, oz, dx, dy, dz)
    if index < 0:
        return 0.0, 0.0, 0.0
    solid = solids[index]
    x, y, z = ox + t * dx, oy + t * dy, oz + t * dz
    lx, ly, lz = local(solid, x, y, z)
    material = materials[material_at(solid, lx, ly, lz)]
    red, green, blue = albedo(material, index, lx, ly, lz)
    if material.emission[0] > 0.0:
        return material.emission[0] * red, material.emission[1] * green, material.emission[2] * blue
    n = normal(solid, x, y, z)
    if n[0] * dx + n[1] * dy + n[2] * dz > 0.0:
        n = (-n[0], -n[1], -n[2])
    light = _openness(solids, x, y, z, n)
    for zone in range(zones.shape[0]):
        light *= _dimming(zones[zone], x, y, z)
    r, g, b = ambient[0] * light * red, ambient[1] * light * green, ambient[2] * light * blue
    # Leave the surface before looking for shadows: rounding may have put the point inside it.
    x, y, z = x + 1e3 * EPSILON * n[0], y + 1e3 * EPSILON * n[1], z + 1e3 * EPSILON * n[2]
    for index in range(lights.shape[0]):
        lamp = lights[index]
        ex, ey, ez = lamp.place[0] - x, lamp.place[1] - y, lamp.place[2] - z
        square = ex * ex + ey * ey + ez * ez
        length = math.sqrt(square)
        ex, ey, ez = ex / length, ey / length, ez / length
        cosine = n[0] * ex + n[1] * ey + n[2] * ez
        if cosine <= 0.0 or shadowed(solids, x, y, z, ex, ey, ez, length - lamp.radius):
            continue
        flux = cosine / square
        shine = 0.0
        if material.gloss > 0.0:
            hx, hy, hz = ex - dx, ey - dy, ez - dz
            along = (n[0] * hx + n[1] * hy + n[2] * hz) / math.sqrt(hx * hx + hy * hy + hz * hz)
            power = material.sharpness
            shine = material.gloss * (power + 8.0) / (8.0 * math.pi) * max(along, 0.0) ** power
        r += lamp.intensity[0] * flux * (red / math.pi + shine)
        g += lamp.intensity[1] * flux * (green / math.pi + shine)
        b += lamp.intensity[2] * flux * (blue / math.pi + shine)
    return r, g, b


@compiled
def trace(
    solids: np.ndarray,
    materials: np.ndarray,
    lights: np.ndarray,
    zones: np.ndarray,
    ambient: np.ndarray,
    origins: np.ndarray,
    directions: np.ndarray,
    colour: np.ndarray,
    depth: np.ndarray,
    which: np.ndarray,
) -> None:
    """Fill radiance [N, 3], distance [N] and solid index [N] for unit rays [N, 3], float64."""
    for i in range(origins.shape[0]):
        o, d = origins[i], directions[i]
        which[i], depth[i] = nearest(solids, o[0], o[1], o[2], d[0], d[1], d[2])
        colour[i, 0], colour[i, 1], colour[i, 2] = radiance_of_ray(
            solids, materials, lights, zones, ambient, o[0], o[1], o[2], d[0], d[1], d[2]
        )


@compiled
def surfaces(
    solids: np.ndarray,
    materials: np.ndarray,
    origins: np.ndarray,
    directions: np.ndarray,
    normals: np.ndarray,
    colours: np.ndarray,
) -> None:
    """Fill outward normals and reflectances [N, 3] of what unit rays [N, 3] meet first; NaN if nothing."""
    for i in range(origins.shape[0]):
        o, d = origins[i], directions[i]
        index, t = nearest(solids, o[0], o[1], o[2], d[0], d[1], d[2])
        normals[i], colours[i] = np.nan, np.nan
        if index >= 0:
            solid = solids[index]
            x, y, z = o[0] + t * d[0], o[1] + t * d[1], o[2] + t * d[2]
            lx, ly, lz = local(solid, x, y, z)
            normals[i, 0], normals[i, 1], normals[i, 2] = normal(solid, x, y, z)
            red, green, blue = albedo(materials[material_at(solid, lx, ly, lz)], index, lx, ly, lz)
            colours[i, 0], colours[i, 1], colours[i, 2] = red, green, blue


@compiled
def render(
    solids: np.ndarray,
    materials: np.ndarray,
    lights: np.ndarray,
    zones: np.ndarray,
    ambient: np.ndarray,
    lens: np.ndarray,
    world_from_cam: np.ndarray,
    samples: int,
    image: np.ndarray,
    first: int,
) -> None:
    """Fill `image`, float32 [rows, width, 3], whose first row is row `first` of the view.

    A pixel is the mean radiance of samples x samples rays through it. lens: as of
    `drivers.sim.camera.lens.parameters`.
    """
    m = world_from_cam
    rows, width, _ = image.shape
    for row in range(rows):
        for column in range(width):
            r, g, b = 0.0, 0.0, 0.0
            for sample in range(samples * samples):
                u = column + (sample % samples + 0.5) / samples
                v = first + row + (sample // samples + 0.5) / samples
                x, y = ray(u, v, lens)
                scale = 1.0 / math.sqrt(x * x + y * y + 1.0)
                red, green, blue = radiance_of_ray(
                    solids,
                    materials,
                    lights,
                    zones,
                    ambient,
                    m[0, 3],
                    m[1, 3],
                    m[2, 3],
                    (m[0, 0] * x + m[0, 1] * y + m[0, 2]) * scale,
                    (m[1, 0] * x + m[1, 1] * y + m[1, 2]) * scale,
                    (m[2, 0] * x + m[2, 1] * y + m[2, 2]) * scale,
                )
                r, g, b = r + red, g + green, b + blue
            image[row, column, 0] = r / (samples * samples)
            image[row, column, 1] = g / (samples * samples)
            image[row, column, 2] = b / (samples * samples)

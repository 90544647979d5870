"""A scene made of solids, materials and lights whose radiance is known in closed form for every ray."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from drivers.sim.camera.lens import parameters
from drivers.sim.scene import raycast
from drivers.sim.scene.raycast import DIM_ZONE, LIGHT
from drivers.sim.scene.solids import BOX, CYLINDER, ROOM, SOLID, SPHERE
from drivers.sim.scene.texture import MATERIAL
from imaging.arrays import Array, Array32, Integers
from imaging.compute.threads import share_pieces
from imaging.optics.lens import Lens

SATIN = 12.0
"""Sharpness of the highlights on what has none of its own: some 20 degrees wide."""


@dataclass(frozen=True)
class Scene:
    """Simulated scene. World axes: metres, z up.

    solids, materials, lights, zones: structured arrays (dtypes in solids, texture, raycast);
    ambient: radiance that arrives from everywhere, linear Rec.709 [3].
    """

    solids: npt.NDArray[np.void]
    materials: npt.NDArray[np.void]
    lights: npt.NDArray[np.void]
    zones: npt.NDArray[np.void]
    ambient: Array

    def radiance(self, origin: npt.ArrayLike, direction: npt.ArrayLike) -> Array:
        """Radiance along rays, linear Rec.709, float64 [..., 3]; directions need not be unit."""
        return self._trace(origin, direction)[0]

    def depth(self, origin: npt.ArrayLike, direction: npt.ArrayLike) -> Array:
        """Distance in metres to the first surface along rays, float64 [...]; inf for a miss."""
        return self._trace(origin, direction)[1]

    def surfaces(self, origin: npt.ArrayLike, direction: npt.ArrayLike) -> tuple[Array, Array]:
        """Outward unit normals and reflectances of what rays meet, float64 [..., 3]; NaN for a miss."""
        origins, directions = _rays(origin, direction)
        normals, colours = np.empty(origins.shape), np.empty(origins.shape)
        raycast.surfaces(self.solids, self.materials, origins, directions, normals, colours)
        shape = np.shape(direction)
        return normals.reshape(shape), colours.reshape(shape)

    def render(self, lens: Lens, cam_from_world: Array, samples: int = 4) -> Array32:
        """Radiance averaged over each pixel by samples x samples rays, float32 [H, W, 3]."""
        image = np.empty((lens.height, lens.width, 3), np.float32)
        values, world_from_cam = parameters(lens), np.linalg.inv(cam_from_world)

        def rows(first: int, last: int) -> None:
            raycast.render(*self._parts, values, world_from_cam, samples, image[first:last], first)

        share_pieces(lens.height, 8, rows)
        return image

    def brightened(self, factor: float) -> "Scene":
        """The same scene with all its light, lamps included, times a factor; 0 is darkness."""
        materials, lights = self.materials.copy(), self.lights.copy()
        # A lamp that is off keeps the sign that makes it a lamp.
        materials["emission"] = np.where(
            materials["emission"] > 0, np.maximum(materials["emission"] * factor, 1e-300), 0.0
        )
        lights["intensity"] *= factor
        return Scene(self.solids, materials, lights, self.zones, self.ambient * factor)

    def evenly_lit(self, radiance: float) -> "Scene":
        """The same things without lamps, shadows and highlights: light of one radiance from everywhere."""
        materials = self.materials.copy()
        materials["emission"] = 0.0
        return Scene(self.solids, materials, self.lights[:0], self.zones[:0], np.full(3, radiance))

    def polished(self, gloss: float) -> "Scene":
        """The same scene with all surfaces of one gloss; 0: none looks different from another side."""
        materials = self.materials.copy()
        materials["gloss"] = gloss
        materials["sharpness"] = np.maximum(materials["sharpness"], SATIN)
        return Scene(self.solids, materials, self.lights, self.zones, self.ambient)

    @property
    def _parts(self) -> tuple[Any, Any, Any, Any, Array]:
        return self.solids, self.materials, self.lights, self.zones, self.ambient

    def _trace(self, origin: npt.ArrayLike, direction: npt.ArrayLike) -> tuple[Array, Array, Integers]:
        origins, directions = _rays(origin, direction)
        count = len(origins)
        colour, depth, which = np.empty((count, 3)), np.empty(count), np.empty(count, np.int64)

        def rays(first: int, last: int) -> None:
            piece = slice(first, last)
            raycast.trace(
                *self._parts, origins[piece], directions[piece], colour[piece], depth[piece], which[piece]
            )

        share_pieces(count, 4096, rays)
        shape = np.shape(direction)
        return colour.reshape(shape), depth.reshape(shape[:-1]), which.reshape(shape[:-1])


def _rays(origin: npt.ArrayLike, direction: npt.ArrayLike) -> tuple[Array, Array]:
    """Origins and unit directions of rays, float64 [N, 3] each."""
    towards = np.asarray(direction, np.float64)
    unit = towards / np.linalg.norm(towards, axis=-1, keepdims=True)
    start = np.broadcast_to(np.asarray(origin, np.float64), unit.shape)
    return np.ascontiguousarray(start.reshape(-1, 3)), np.ascontiguousarray(unit.reshape(-1, 3))


class Builder:
    """Collects solids, materials, lights and dim zones into a Scene."""

    def __init__(self) -> None:
        self._solids: list[npt.NDArray[np.void]] = []
        self._materials: list[npt.NDArray[np.void]] = []
        self._lights: list[npt.NDArray[np.void]] = []
        self._zones: list[npt.NDArray[np.void]] = []

    def material(
        self,
        pattern: int,
        cell: float | tuple[float, float, float],
        *colours: tuple[float, float, float],
        edge: float = 1.0,
        warp: float = 0.0,
        detail: float = 0.15,
        gloss: float = 0.0,
        sharpness: float = 1.0,
        emission: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> int:
        """Add a material and return its index; its seed is that index, so no two look alike."""
        entry = np.zeros(1, MATERIAL)
        index = len(self._materials)
        entry["pattern"], entry["seed"] = pattern, 100_000 * (index + 1)
        entry["cell"] = cell
        entry["edge"], entry["warp"], entry["detail"] = edge, warp, detail
        entry["colours"] = colours if len(colours) == 3 else [colours[0]] * 3
        entry["gloss"], entry["sharpness"], entry["emission"] = gloss, sharpness, emission
        self._materials.append(entry)
        return index

    def _solid(
        self,
        kind: int,
        material: int,
        centre: tuple[float, float, float],
        half: tuple[float, float, float],
        turn: float,
        blocks: bool,
    ) -> None:
        entry = np.zeros(1, SOLID)
        entry["kind"], entry["material"], entry["blocks"] = kind, material, blocks
        entry["cx"], entry["cy"], entry["cz"] = centre
        entry["hx"], entry["hy"], entry["hz"] = half
        entry["cos"], entry["sin"] = math.cos(math.radians(turn)), math.sin(math.radians(turn))
        entry["bound"] = {
            SPHERE: half[0],
            CYLINDER: math.hypot(half[0], half[2]),
            BOX: math.hypot(*half),
            ROOM: math.hypot(*half),
        }[kind] * (1.0 + 1e-9)
        self._solids.append(entry)

    def sphere(
        self, material: int, centre: tuple[float, float, float], radius: float, *, blocks: bool = True
    ) -> None:
        """A ball."""
        self._solid(SPHERE, material, centre, (radius, radius, radius), 0.0, blocks)

    def box(
        self,
        material: int,
        centre: tuple[float, float, float],
        size: tuple[float, float, float],
        *,
        turn: float = 0.0,
        blocks: bool = True,
    ) -> None:
        """A box of full size `size`, turned by `turn` degrees about the vertical."""
        self._solid(BOX, material, centre, (size[0] / 2, size[1] / 2, size[2] / 2), turn, blocks)

    def cylinder(
        self,
        material: int,
        centre: tuple[float, float, float],
        radius: float,
        height: float,
        *,
        blocks: bool = True,
    ) -> None:
        """An upright cylinder with flat ends."""
        self._solid(CYLINDER, material, centre, (radius, radius, height / 2), 0.0, blocks)

    def room(
        self,
        materials: tuple[int, int, int, int, int, int],
        low: tuple[float, float, float],
        high: tuple[float, float, float],
        *,
        turn: float = 0.0,
    ) -> None:
        """The room that everything stands in, from corner to corner, turned about its middle as a box is.

        materials: of the walls at low and high x, at low and high y, of floor and ceiling; consecutive.
        """
        if materials != tuple(range(materials[0], materials[0] + 6)):
            raise ValueError("the materials of a room are added one after the other")
        centre = ((low[0] + high[0]) / 2, (low[1] + high[1]) / 2, (low[2] + high[2]) / 2)
        half = ((high[0] - low[0]) / 2, (high[1] - low[1]) / 2, (high[2] - low[2]) / 2)
        self._solid(ROOM, materials[0], centre, half, turn, False)

    def light(
        self, place: tuple[float, float, float], intensity: tuple[float, float, float], radius: float = 0.0
    ) -> None:
        """A point light of a radiant intensity; it casts hard shadows."""
        entry = np.zeros(1, LIGHT)
        entry["place"], entry["intensity"], entry["radius"] = place, intensity, radius
        self._lights.append(entry)

    def dim_zone(
        self,
        centre: tuple[float, float, float],
        size: tuple[float, float, float],
        sides: tuple[int, int, int],
        reach: float,
        stops: float,
        turn: float = 0.0,
    ) -> None:
        """A half-closed space into which the ambient light falls off by `stops` over `reach` metres.

        sides: per axis 0 closed, 1 open at the low end, 2 at the high end, 3 at both.
        """
        entry = np.zeros(1, DIM_ZONE)
        entry["centre"], entry["half"] = centre, (size[0] / 2, size[1] / 2, size[2] / 2)
        entry["cos"], entry["sin"] = math.cos(math.radians(turn)), math.sin(math.radians(turn))
        entry["sides"], entry["reach"], entry["stops"] = sides, reach, stops
        self._zones.append(entry)

    def scene(self, ambient: tuple[float, float, float]) -> Scene:
        """The scene."""
        zones = np.concatenate(self._zones) if self._zones else np.zeros(0, DIM_ZONE)
        lights = np.concatenate(self._lights) if self._lights else np.zeros(0, LIGHT)
        return Scene(
            np.concatenate(self._solids), np.concatenate(self._materials), lights, zones, np.array(ambient)
        )

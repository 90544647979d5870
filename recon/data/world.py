"""The coordinates that a scene is trained in, whatever the origin and the unit of the user's world."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Self

import numpy as np
import numpy.typing as npt
from pydantic import Field

from imaging.arrays import Array
from imaging.files.colmap import read_tracks
from imaging.record import Record
from recon.splat import SplatCamera

Vector = tuple[float, float, float]

ROUNDING_PX = 0.01
"""Largest movement of image points by float32 coordinates, px."""


class WorldTransform(Record):
    """World coordinates are `origin + unit * scene`, float64; the axes of both are the same.

    Geodetic coordinates, millimetres and kilometres would lose a scene to float32, and to every constant that
    is a length. In scene coordinates the origin is amid the cameras, and what they look at is about 1 away.
    """

    origin: Vector = (0.0, 0.0, 0.0)
    unit: float = Field(default=1.0, gt=0)
    """World units."""

    @classmethod
    def of(cls, cameras: Mapping[str, Array], colmap: Path) -> Self:
        """Choose the scene's coordinates for cameras, by image name of the model in the folder `colmap`:
        cam_from_world [4, 4] each.

        The origin is the median of their centres; the unit the median, over the cameras, of the median depth
        of the points that a camera saw, or of all in front of it where the model does not say. Without
        points it is the largest distance of a camera from the origin, as in 3DGS, or 1 if that is 0.
        """
        centres = np.array([-motion[:3, :3].T @ motion[:3, 3] for motion in cameras.values()])
        origin = np.median(centres, axis=0)
        xyz, tracks = read_tracks(colmap)
        depths = []
        for name, motion in cameras.items():
            rows = tracks.get(name)
            depth = (xyz if rows is None or not len(rows) else xyz[rows]) @ motion[2, :3] + motion[2, 3]
            if (depth > 0).any():
                depths.append(np.median(depth[depth > 0]))
        reach = float(np.linalg.norm(centres - origin, axis=1).max())
        return cls(origin=tuple(origin.tolist()), unit=float(np.median(depths)) if depths else reach or 1.0)

    def to_world(self, xyz: npt.ArrayLike) -> Array:
        """Scene coordinates [..., 3] in the world."""
        return np.asarray(xyz, np.float64) * self.unit + self.origin

    def from_world(self, xyz: npt.ArrayLike) -> Array:
        """World coordinates [..., 3] in the scene."""
        return (np.asarray(xyz, np.float64) - self.origin) / self.unit

    def camera(self, camera: SplatCamera) -> SplatCamera:
        """A camera that stands in the world, in the scene: the same picture."""
        motion = np.array(camera.cam_from_world, np.float64)
        motion[:3, 3] = (motion[:3, :3] @ self.origin + motion[:3, 3]) / self.unit
        return replace(camera, cam_from_world=motion)

    def camera_in_world(self, camera: SplatCamera) -> SplatCamera:
        """The inverse of `camera`."""
        motion = np.array(camera.cam_from_world, np.float64)
        motion[:3, 3] = motion[:3, 3] * self.unit - motion[:3, :3] @ self.origin
        return replace(camera, cam_from_world=motion)

    def offset(self, focal: float) -> Vector:
        """Offset subtracted from world coordinates before float32, for focal lengths up to `focal` px.

        Zero where rounding to float32 moves nothing by more than `ROUNDING_PX` at the scene's depth; else
        the origin, rounded to ten times the power of ten next to the unit, so that it is short to write.
        """
        away = max(map(abs, self.origin)) / self.unit
        if away * 2.0**-24 * focal <= ROUNDING_PX:
            return 0.0, 0.0, 0.0
        digits = -1 - round(np.log10(self.unit))
        x, y, z = (round(value, digits) for value in self.origin)
        return x, y, z


SAME = WorldTransform()
"""The scene's coordinates are those of the world."""

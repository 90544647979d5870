"""Rigid motions: where a camera, a rig or a board stands."""

from collections.abc import Sequence

import numpy as np

from imaging.arrays import Array
from imaging.record import Record

OPENGL_FROM_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])
"""Camera axes: x right, y up, z back from x right, y down, z ahead; its own inverse."""
_TILTED = np.cos(np.radians(45.0))
"""Cosine between the mean of up in the pictures and what is square to their rows, if they were held level."""


def world_from_opengl(cam_from_world: Array) -> Array:
    """Camera to world, float64 [4, 4], of camera axes x right, y up, z back, as OpenGL and USD have them."""
    return np.asarray(np.linalg.inv(cam_from_world) @ OPENGL_FROM_OPENCV)


class Pose(Record):
    """A rigid motion `x_to = R(quaternion) x_from + translation`; quaternion wxyz, unit."""

    quaternion: tuple[float, float, float, float]
    translation: tuple[float, float, float]

    def matrix(self) -> Array:
        """The motion as float64 [4, 4]."""
        w, x, y, z = np.array(self.quaternion) / np.linalg.norm(self.quaternion)
        motion = np.eye(4)
        motion[:3, :3] = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
        motion[:3, 3] = self.translation
        return motion


def upwards(motions: Sequence[Array]) -> Array:
    """A unit vector: what is square to the rows of all pictures, as photographers hold cameras level.

    Where their headings hardly differ, the mean of what is up in the pictures decides.
    """
    mean = -np.sum([motion[1, :3] for motion in motions], axis=0)
    mean = mean / np.linalg.norm(mean) if np.linalg.norm(mean) > 1e-6 else np.array([0.0, -1.0, 0.0])
    rows = np.array([motion[0, :3] for motion in motions])
    pull = 1e-3 * len(rows)
    up = np.linalg.solve(rows.T @ rows + pull * np.eye(3), pull * mean)
    up /= np.linalg.norm(up)
    return np.asarray(up if up @ mean > _TILTED else mean)

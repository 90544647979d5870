"""Rigid motions: where a camera, a rig or a board stands."""

import numpy as np

from imaging.arrays import Array
from imaging.record import Record

OPENGL_FROM_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])
"""Camera axes: x right, y up, z back from x right, y down, z ahead; its own inverse."""


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

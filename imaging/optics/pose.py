"""Rigid motions: where a camera, a rig or a board stands."""

from collections.abc import Sequence
from typing import TypeVar

import numpy as np

from imaging.arrays import AnyArray, Array, Array32, Bytes
from imaging.record import Record

Picture = TypeVar("Picture", Bytes, Array32)
"""Codes, or light."""
OPENGL_FROM_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])
"""Camera axes: x right, y up, z back from x right, y down, z ahead; its own inverse."""
_TILTED = np.cos(np.radians(45.0))
"""Cosine between the mean of up in the pictures and what is square to their rows, if they were held level."""
_QUARTER = np.array([[0.0, 1.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""Axes of a picture after a quarter turn to the left, from those before it: its right becomes its top."""
_GRIP_UP = 8
"""The orientation of EXIF that such a turn shows upright."""
_MIRRORED = (2, 4, 5, 7)
"""The orientations of EXIF whose pictures are mirrored."""
_ASKEW = np.sin(np.radians(10.0))
"""Sine of the angle by which cameras that are held level may miss it."""
_STRAYS = 0.1
"""Share of the views that may be turned anyhow: those that are placed wrong, or were held otherwise."""
_FLATTER = 0.1
"""Difference of `_flatness` that is no chance."""


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


def as_held(cam_from_world: Array, orientation: int) -> Array:
    """The motion into the axes of the upright picture, by the orientation that EXIF states of the stored one.

    Its upper side counts, and not that some orientations are mirrored.
    """
    return np.asarray(np.linalg.matrix_power(_QUARTER, quarter_turns(orientation)) @ cam_from_world)


def quarter_turns(orientation: int) -> int:
    """Quarter turns to the left, as of `np.rot90`, that make a picture of this EXIF orientation upright."""
    return {3: 2, 4: 2, 5: 3, 6: 3, 7: 1, 8: 1}.get(orientation, 0)


def picture_as_held(pixels: Picture, orientation: int) -> Picture:
    """A stored picture [H, W, ...] in the axes of `as_held`: upright, and mirrored if it is stored so."""
    return np.ascontiguousarray(np.rot90(pixels, quarter_turns(orientation)))


def upright(pixels: AnyArray, orientation: int) -> AnyArray:
    """Turn a picture [H, W, ...] of this EXIF orientation upright, and undo its mirroring."""
    turned = np.rot90(pixels, quarter_turns(orientation))
    return turned[:, ::-1] if orientation in _MIRRORED else turned


def on_their_side(motions: Sequence[Array]) -> bool:
    """True for views whose columns, and not their rows, lie in one plane, all round.

    Columns of level cameras, which none tilts beyond straight up or down, leave half of any plane empty.
    """
    rows, columns = (np.array([motion[axis, :3] for motion in motions]) for axis in (0, 1))
    plane = np.linalg.eigh(columns.T @ columns)[1][:, 1:]
    turns = np.radians(np.arange(0, 360, 5))
    heights = columns @ plane @ np.stack([np.cos(turns), np.sin(turns)])
    around = bool(((heights > _ASKEW).mean(axis=0) > _STRAYS).all())
    return around and _flatness(columns) > _flatness(rows) + _FLATTER


def _flatness(axes: Array) -> float:
    """Spread of unit vectors [N, 3] within one plane, beyond that out of it; 0..0.5."""
    least, middle, _ = np.linalg.eigvalsh(axes.T @ axes / len(axes))
    return float(middle - least)


def upwards(motions: Sequence[Array]) -> Array:
    """A unit vector: what is square to the rows of all pictures, as photographers hold cameras level.

    Where their headings hardly differ, the mean of what is up in the pictures decides. Motions are those of
    upright pictures (`as_held`) where files state how they were held. Pictures that stand on their side all
    the same are taken to have their right side up, as of a camera whose grip is up; of most telephones it is
    the left.
    """
    if on_their_side(motions):
        motions = [as_held(motion, _GRIP_UP) for motion in motions]
    mean = -np.sum([motion[1, :3] for motion in motions], axis=0)
    mean = mean / np.linalg.norm(mean) if np.linalg.norm(mean) > 1e-6 else np.array([0.0, -1.0, 0.0])
    rows = np.array([motion[0, :3] for motion in motions])
    pull = 1e-3 * len(rows)
    up = np.linalg.solve(rows.T @ rows + pull * np.eye(3), pull * mean)
    up /= np.linalg.norm(up)
    return np.asarray(up if up @ mean > _TILTED else mean)

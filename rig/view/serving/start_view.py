"""Start of a browser's camera when its page opens."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import viser
from scipy.spatial.transform import Rotation

from imaging.arrays import Array
from imaging.optics.lens import Lens, rays
from imaging.optics.pose import upwards

Point = tuple[float, float, float]
Pair = tuple[Array, Array]


@dataclass(frozen=True)
class Start:
    """position, look_at and up: in the coordinates of the page; fov: from top to bottom, radians."""

    position: Point
    look_at: Point
    up: Point
    fov: float


def point(vector: npt.ArrayLike) -> Point:
    """A vector of three as plain numbers, which is what a browser is sent."""
    x, y, z = np.asarray(vector, np.float64).tolist()
    return x, y, z


NARROW = 600
"""CSS px of a window's width below which all controls would hide the picture: some begin folded."""
WIDEST = np.radians(120.0)
"""Widest vertical field of view requested of a browser."""


def height_angle(lens: Lens) -> float:
    """Vertical angle of a lens's picture, radians."""
    ends = rays(lens, [[lens.cx, 0.0], [lens.cx, lens.height]])
    return float(min(np.arccos(np.clip(ends[0] @ ends[1], -1, 1)), WIDEST))


def start_at(motion: Array, up: npt.ArrayLike, lens: Lens) -> Start:
    """Return where a camera stands, cam_from_world [4, 4], seen through the lens of its upright picture."""
    centre = -motion[:3, :3].T @ motion[:3, 3]
    return Start(point(centre), point(centre + motion[2, :3]), point(up), height_angle(lens))


def overview(poses: Sequence[Array]) -> Start:
    """Place that overlooks cameras about the origin, cam_from_world [4, 4] as held: behind and above them."""
    up = upwards(poses)
    ahead = sum((pose[2, :3] for pose in poses), np.zeros(3))
    ahead = ahead / max(float(np.linalg.norm(ahead)), 1e-6)
    centres = np.array([-pose[:3, :3].T @ pose[:3, 3] for pose in poses])
    reach = 1.0 + float(np.linalg.norm(centres, axis=1).max())
    return Start(point(reach * (0.9 * up - 1.2 * ahead)), point(0.3 * ahead), point(up), 0.9)


def pose_of(cam_from_world: Array) -> Pair:
    """wxyz and position of a motion [4, 4], as a browser has them."""
    turn = cam_from_world[:3, :3].T
    wxyz = Rotation.from_matrix(turn).as_quat(scalar_first=True)
    return np.asarray(wxyz), np.asarray(-turn @ cam_from_world[:3, 3])


def stand(client: viser.ClientHandle, start: Start) -> None:
    """Send the camera of a browser somewhere."""
    camera = client.camera
    with client.atomic():
        camera.position, camera.look_at = np.array(start.position), np.array(start.look_at)
        camera.up_direction, camera.fov = np.array(start.up), start.fov

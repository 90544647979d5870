"""Cameras of the browser and of the scene: one has a position and a turn, the other a matrix and a lens.

All are in the coordinates that the scene was trained in, where what the photographs show is about 1 away.
"""

from typing import Protocol

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from imaging.lens import rays
from recon.result.model import SceneView
from recon.splat import SplatCamera

Vector = npt.NDArray[np.float64]
WIDEST = np.radians(120.0)
"""That the browser is asked to show from top to bottom."""


class BrowserCamera(Protocol):
    """What a browser says of its camera: its axes are those of OpenCV, x right, y down, z ahead."""

    @property
    def wxyz(self) -> Vector:
        """The turn from the camera's axes to the world's, a unit quaternion."""
        ...

    @property
    def position(self) -> Vector:
        """Of its centre."""
        ...

    @property
    def fov(self) -> float:
        """From top to bottom, radians."""
        ...

    @property
    def aspect(self) -> float:
        """Width over height."""
        ...


def splat_camera(camera: BrowserCamera, width: int) -> SplatCamera:
    """The camera of a browser with a picture of some width, px."""
    height = max(1, round(width / camera.aspect))
    world_from_camera = Rotation.from_quat(np.asarray(camera.wxyz), scalar_first=True).as_matrix()
    motion = np.eye(4)
    motion[:3, :3] = world_from_camera.T
    motion[:3, 3] = -world_from_camera.T @ np.asarray(camera.position)
    focal = 0.5 * height / np.tan(0.5 * camera.fov)
    return SplatCamera(motion, focal, focal, width / 2, height / 2, width, height)


def pose(camera: SplatCamera) -> tuple[Vector, Vector]:
    """wxyz and position of a scene's camera, as a browser has them."""
    turn = camera.cam_from_world[:3, :3].T
    wxyz = Rotation.from_matrix(turn).as_quat(scalar_first=True)
    return np.asarray(wxyz), np.asarray(-turn @ camera.cam_from_world[:3, 3])


def field_of_view(view: SceneView) -> float:
    """From the top to the bottom of a view's picture, radians."""
    lens = view.lens
    ends = rays(lens, [[lens.cx, 0.0], [lens.cx, lens.height]])
    return float(min(np.arccos(np.clip(ends[0] @ ends[1], -1, 1)), WIDEST))

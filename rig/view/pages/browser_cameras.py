"""Cameras of the browser and of the scene: one has a position and a turn, the other a matrix and a lens.

All are in the coordinates that the scene was trained in, where what the photographs show is about 1 away.
"""

from typing import Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from imaging.arrays import Array
from imaging.optics.pose import as_held
from recon.result.model import SceneView
from recon.result.scene import Scene
from recon.splat import SplatCamera
from rig.view.serving.start_view import Start, start_at


class BrowserCamera(Protocol):
    """Camera of a browser: its axes are those of OpenCV, x right, y down, z ahead."""

    @property
    def wxyz(self) -> Array:
        """The turn from the camera's axes to the world's, a unit quaternion."""
        ...

    @property
    def position(self) -> Array:
        """Position of its centre."""
        ...

    @property
    def fov(self) -> float:
        """Vertical field of view, radians."""
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


def start_of(scene: Scene, view: SceneView) -> Start:
    """Return where a view stands in the coordinates of its scene."""
    return start_at(motion_as_held(scene, view), scene.up, view.lens.as_held(view.orientation))


def motion_as_held(scene: Scene, view: SceneView) -> Array:
    """The motion from the coordinates of a scene into the axes of a view's upright picture, [4, 4]."""
    return as_held(scene.record.world.camera(view.splat_camera).cam_from_world, view.orientation)

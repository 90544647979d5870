"""Coordinates of a scene for other programs: its unit, its up axis, and the lenses that they can draw."""

from dataclasses import dataclass, replace

import numpy as np

from imaging.arrays import Array
from imaging.files.exr.camera import FILM_MM
from imaging.optics.lens import Lens
from imaging.optics.pose import world_from_opengl
from recon.result.model import CALIBRATION, SceneView, read_own_calibration
from recon.result.scene import Scene
from recon.splat import SplatCamera

_CORNERS = 33
"""Points along each side of a picture where a lens is compared with a pinhole."""


@dataclass(frozen=True, eq=False)
class Place:
    """Coordinate system of a scene.

    metres: whether lengths are metres; else they are in a unit of the scene's own.
    z_up: whether z points up, by a survey or GPS.
    turn: float64 [3, 3]; from the axes of the world to those of the file, of which y is up unless z is.
    note: the coordinates in words.
    """

    metres: bool
    z_up: bool
    turn: Array
    note: str


def place_of(scene: Scene) -> Place:
    """Coordinates from the calibration that the scene was trained on; unknown for a scene without one.

    What no survey and no GPS placed stands as photographers hold their cameras: their way up (`Scene.up`)
    becomes y.
    """
    if not (scene.folder / CALIBRATION).is_file():
        return Place(False, False, _upright(scene), "those of the file, without a unit")
    record = read_own_calibration(scene.folder)
    metres, note = record.unit == "m", record.coordinate_note
    if record.coordinates is not None and record.coordinates.source != "session":
        return Place(metres, True, np.eye(3), note)
    return Place(metres, False, _upright(scene), note)


def in_stage(view: SceneView, scene: Scene, place: Place) -> Array:
    """Return the world_from_camera [4, 4] of a view in the axes of the file, less the scene's offset.

    The camera looks along -z, with y up, as in OpenGL.
    """
    motion = world_from_opengl(view.cam_from_world.matrix())
    motion[:3, 3] -= np.asarray(scene.record.offset)
    motion[:3] = place.turn @ motion[:3]
    return motion


def _upright(scene: Scene) -> Array:
    """The turn that takes the way up to y, and z as far towards the first camera as that allows."""
    up = scene.up
    back = -scene.views[0].splat_camera.cam_from_world[2, :3] if scene.views else np.array([0.0, 0.0, 1.0])
    back = back - (back @ up) * up
    if np.linalg.norm(back) < 1e-6:
        back = np.eye(3)[np.argmin(np.abs(up))]
        back = back - (back @ up) * up
    back = back / np.linalg.norm(back)
    return np.stack([np.cross(up, back), up, back])


@dataclass(frozen=True)
class Film:
    """A lens without its distortion as programs have it that describe cameras by their film, mm.

    across, up: from the lens's axis to the middle of the film, to the right and upwards.
    """

    focal: float
    width: float
    height: float
    across: float
    up: float


def film_of(lens: Lens) -> Film:
    """Return the film, as wide as EXR headers have it; pixels that are not square make it higher or lower."""
    focal = FILM_MM * lens.fx / lens.width
    return Film(
        focal,
        FILM_MM,
        focal * lens.height / lens.fy,
        focal * (lens.width / 2 - lens.cx) / lens.fx,
        focal * (lens.cy - lens.height / 2) / lens.fy,
    )


def pinhole(camera: SplatCamera) -> SplatCamera:
    """The camera with a lens that has no distortion, as most programs draw it."""
    return replace(camera, k1=0.0, k2=0.0, p1=0.0, p2=0.0, k3=0.0, k4=0.0, fisheye=False)


def bent_px(view: SceneView) -> float:
    """Largest displacement by distortion at the border of the pinhole's picture, px."""
    straight = pinhole(view.splat_camera)
    ends, near, far = np.linspace(0, 1, _CORNERS), np.zeros(_CORNERS), np.ones(_CORNERS)
    border = np.concatenate([(ends, near), (ends, far), (near, ends), (far, ends)], axis=1).T
    pixels = border * [straight.width, straight.height]
    centre, focal = np.array([straight.cx, straight.cy]), np.array([straight.fx, straight.fy])
    bent = view.splat_camera.distort((pixels - centre) / focal) * focal + centre
    return float(np.linalg.norm(bent - pixels, axis=1).max())

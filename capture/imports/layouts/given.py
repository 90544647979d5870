"""Contents of a layout, and the checks that every layout shares."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from capture.imports.request import LayoutName
from imaging.arrays import Array
from imaging.errors import InputError
from imaging.optics.exposure import Exposure
from imaging.optics.lens import Lens, LensModel
from imaging.optics.pose import Pose
from imaging.session.turntable import TurntableRecord

FARTHEST = 1e9
"""A camera further than this from the origin, in any unit, is a damaged number."""
ROUNDING = 1e-3
"""Tolerance of the columns of a rotation from unit and orthogonal: files round to few digits."""

OPENCV_FROM_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
"""Camera axes x right, y up, z back become x right, y down, z forward."""


@dataclass(frozen=True)
class GivenDepth:
    """Depth map of a photograph. unit: length of 1 in it in units of the world, if stated."""

    path: Path
    unit: float | None = None


@dataclass(frozen=True)
class GivenPhoto:
    """Photograph that a layout names.

    camera: the layout's word for the camera; photographs of one word share a lens. lens: at the size that the
    layout states, None where rig has no such lens model. cam_from_world: None where the layout has no pose.
    frame: photographs of one camera and frame are a bracket; None if unknown. use: training or test, in a
    data set with its own split; None: neither. mask: its mask or None. depth: its depth map or None.
    """

    path: Path
    camera: str
    lens: Lens | None = None
    cam_from_world: Pose | None = None
    exposure: Exposure | None = None
    frame: int | None = None
    use: Literal["train", "test"] | None = None
    mask: Path | None = None
    depth: GivenDepth | None = None


@dataclass(frozen=True)
class Given:
    """A layout that was read. photos: in order.

    source: the file that most was read from. model: folder of a COLMAP model with scene points, whose
    names are relative to `images`. developed: the photograph that each of the model's images was made of,
    where they are copies; empty: they are the photographs. rigs: of cameras that are mounted to each other,
    the name of their rig and `cam_from_rig`. points: float64 [P, 3], world, of scene points that come
    alone. truth: true light of a frame, linear EXR. missing: a sentence for each photograph that is named
    and not there. notes: what was assumed, or could not be kept. turntable: angles of one, by frame.
    """

    layout: LayoutName
    source: Path
    photos: tuple[GivenPhoto, ...]
    model: Path | None = None
    images: Path | None = None
    developed: Mapping[str, Path] = field(default_factory=dict)
    rigs: dict[str, tuple[str, Pose]] = field(default_factory=dict)
    points: Array | None = None
    truth: dict[int, Path] = field(default_factory=dict)
    missing: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    turntable: TurntableRecord | None = None

    @property
    def teller(self) -> str:
        """The source as sentences name it: `transforms.json`, `sparse/0`."""
        return f"{self.source.parent.name}/{self.source.name}" if self.source.is_dir() else self.source.name


def pose_of(cam_from_world: Array, where: str) -> Pose:
    """A rigid motion [4, 4] in OpenCV's axes as a Pose; InputError, naming `where`, if it is not rigid."""
    rotation, translation = cam_from_world[:3, :3], cam_from_world[:3, 3]
    if cam_from_world.shape != (4, 4) or not np.isfinite(cam_from_world).all():
        raise InputError(f"{where} has a pose that is not a 4x4 matrix of finite numbers: export it again.")
    if np.abs(rotation.T @ rotation - np.eye(3)).max() > ROUNDING or np.linalg.det(rotation) < 0:
        raise InputError(
            f"{where} has a pose that scales, shears or mirrors instead of only rotating: correct it."
        )
    if not np.allclose(cam_from_world[3], [0, 0, 0, 1]) or np.abs(translation).max() > FARTHEST:
        raise InputError(f"{where} has an impossible pose: correct it or remove the entry.")
    w, x, y, z = Rotation.from_matrix(rotation).as_quat(canonical=True, scalar_first=True).tolist()
    tx, ty, tz = translation.tolist()
    return Pose(quaternion=(w, x, y, z), translation=(tx, ty, tz))


def pose_seen(world_from_cam: Array, where: str) -> Pose:
    """The pose of a camera [4, 4] in OpenCV's axes; InputError, naming `where`, if it is not rigid.

    Its centre stays what is stated: a rounded rotation is made a rotation before it is turned round, since
    far from the origin its inverse would move the camera.
    """
    if np.isfinite(world_from_cam).all() and not np.linalg.det(world_from_cam):
        raise InputError(f"{where} has a pose that is not a 4x4 matrix of finite numbers: export it again.")
    centre = pose_of(world_from_cam, where)
    rotation = centre.matrix()[:3, :3]
    cam_from_world = np.eye(4)
    cam_from_world[:3, :3] = rotation.T
    cam_from_world[:3, 3] = -rotation.T @ world_from_cam[:3, 3]
    return pose_of(cam_from_world, where)


def lens_of(model: LensModel, size: tuple[int, int], parameters: dict[str, float], where: str) -> Lens:
    """A lens for pictures of a size.

    Args:
        model: Lens model.
        size: Width and height of the pictures, px.
        parameters: fx, fy, cx, cy, px, and any of k1, k2, p1, p2, of a fisheye of k1, k2, k3, k4.
        where: Name of the place in the layout, which begins the sentence of an error.

    Returns:
        The lens.

    Raises:
        InputError: There can be no such lens: a parameter is invalid or out of proportion to the size. It
            names `where`.
    """
    width, height = size
    try:
        lens = Lens(model=model, width=width, height=height, **parameters)
    except ValidationError as error:
        first = error.errors()[0]
        field_name = ".".join(str(part) for part in first["loc"])
        raise InputError(
            f"{where} has a lens that cannot be ({field_name}: {first['msg'].lower()}): correct it."
        ) from error
    diagonal = math.hypot(width, height)
    sound = (
        all(1e-3 * diagonal < focal < 1e4 * diagonal for focal in (lens.fx, lens.fy))
        and abs(lens.cx - width / 2) < 2 * width
        and abs(lens.cy - height / 2) < 2 * height
        and all(abs(term) < 1e3 for term in lens.terms[4:])
    )
    if not sound:
        raise InputError(
            f"{where} has a lens that cannot be (focal length, centre or distortion out of "
            f"proportion to {width}x{height} pixels): correct it."
        )
    return lens

"""Transform from the world of a calibration to a file of `rig export`, for cameras that were made in that
file.

A stage of USD and a file of glTF are turned level, and coordinates that float32 could not hold are written
less an offset. Programs turn and scale them once more: Blender has z up, other stages are in centimetres.
"""

import json
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from imaging.arrays import Array
from imaging.errors import InputError
from recon.data.world import Vector
from recon.rendering.cameras.camera_paths import CameraPath, placed
from recon.scene.ply_file import stated_offset
from recon.scene.usd_field import PLACED, column_matrix, unscaled
from recon.splat import SplatCamera

USD_SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
_Y_FROM_Z = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
_SAME = 1e-6
"""Relative tolerance of two definitions in one stage."""


@dataclass(frozen=True)
class Axes:
    """Coordinate system of a program: whether z is up, else y, None: as in that of the file; metres: of a
    unit.
    """

    z_up: bool | None
    metres: float = 1.0

    def to(self, other: "Axes") -> Array:
        """The matrix [3, 3] that takes coordinates in these to others."""
        turn = np.eye(3)
        if self.z_up is not None and other.z_up is not None and self.z_up != other.z_up:
            turn = _Y_FROM_Z if self.z_up else _Y_FROM_Z.T
        return np.asarray(turn * (self.metres / other.metres))


@dataclass(frozen=True, eq=False)
class Placement:
    """Place of the world of a calibration in a file.

    file_from_local: float64 [4, 4], a rotation, one scale and a shift, from coordinates of the exported
    scene; offset: world coordinates are those of the scene plus this; axes: of the file, None: no axis is
    called up.
    """

    file_from_local: Array
    offset: Vector
    axes: Axes | None

    def in_world(self, camera: SplatCamera, axes: Axes | None, *, shifted: bool) -> SplatCamera:
        """Transform a camera that was placed in the file, by a program of some axes, None: those of the
        file.

        shifted: whether the offset belongs to the requested world.
        """
        turn = camera.cam_from_world[:3, :3].T
        centre = -turn @ camera.cam_from_world[:3, 3]
        if axes is not None and self.axes is not None:
            moved = axes.to(self.axes)
            turn, centre = moved @ turn, moved @ centre
        local_from_file = np.linalg.inv(self.file_from_local)
        centre = local_from_file[:3, :3] @ centre + local_from_file[:3, 3]
        turn = unscaled(local_from_file[:3, :3] @ turn)
        return placed(camera, centre + np.asarray(self.offset) if shifted else centre, turn)


@dataclass(frozen=True, eq=False)
class GivenPath:
    """Cameras in a file, and its statement on its coordinates, or None."""

    path: CameraPath
    axes: Axes | None = None
    placement: Placement | None = None


def less(offset: Sequence[float]) -> Placement:
    """Placement of a file whose coordinates are those of the calibration less an offset."""
    x, y, z = map(float, offset)
    return Placement(np.eye(4), (x, y, z), None)


def placement_of(path: Path) -> Placement:
    """Read the placement in a file of `rig export`: USD, glTF or PLY; InputError for another, or one without
    a placement.
    """
    suffix = path.suffix.lower()
    if not path.is_file():
        raise InputError(f"{path} does not exist: name the rig export that the cameras were made in.")
    placement = None
    if suffix in USD_SUFFIXES:
        placement = placement_in(open_stage(path), path)
    elif suffix == ".glb":
        placement = _in_gltf(path)
    elif suffix == ".ply":
        placement = _in_ply(path)
    if placement is None:
        raise InputError(
            f"{path} does not state where the scene lies in it: name a USD, glb or PLY file of rig export."
        )
    return placement


def open_stage(path: Path) -> Any:
    """A stage of USD; InputError if usd-core is missing or the file cannot be read."""
    try:
        from pxr import Tf, Usd
    except ImportError as error:
        raise InputError(
            f"{path} is read by usd-core, which is not installed: pip install -e '.[usd]', or export the "
            "camera as CSV."
        ) from error
    try:
        return Usd.Stage.Open(str(path))
    except Tf.ErrorException as error:
        raise InputError(f"{path} is damaged or not USD: export it again.") from error


def axes_of(stage: Any) -> Axes:
    """Axes of a stage."""
    from pxr import UsdGeom

    z_up = UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z
    return Axes(z_up, float(UsdGeom.GetStageMetersPerUnit(stage)))


def placement_in(stage: Any, path: Path) -> Placement | None:
    """Return the transform to a stage, exported again or not, from the world of a calibration; None if it has
    none.

    InputError if it is stretched, or defined several times at different places.
    """
    from pxr import Usd, UsdGeom

    placements: list[Placement] = []
    for prim in stage.Traverse():
        value = prim.GetAttribute(PLACED).Get() if prim.HasAttribute(PLACED) else None
        if value is None:
            continue
        placed_at = UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(Usd.TimeCode.EarliestTime())
        matrix = column_matrix(placed_at)
        turn, (x, y, z) = matrix[:3, :3], map(float, value)
        size = float(np.linalg.norm(turn)) / np.sqrt(3)
        if not size > 0 or not np.allclose(turn.T @ turn, size**2 * np.eye(3), atol=_SAME * size**2):
            raise InputError(
                f"{path} stretches {prim.GetPath()}, which stands for the scene: scale it evenly."
            )
        if np.linalg.det(turn) < 0:
            raise InputError(f"{path} mirrors {prim.GetPath()}, which stands for the scene: turn it back.")
        placements.append(Placement(matrix, (x, y, z), axes_of(stage)))
    if not placements:
        return None
    first = placements[0]
    if not all(np.allclose(first.file_from_local, other.file_from_local, atol=_SAME) for other in placements):
        raise InputError(
            f"{path} has the scene {len(placements)} times at different places: leave one of them."
        )
    return first


def _in_gltf(path: Path) -> Placement | None:
    """Read the node that draws the Gaussians, and the extras of its mesh."""
    raw = path.read_bytes()
    try:
        size = struct.unpack("<I", raw[12:16])[0]
        content = json.loads(raw[20 : 20 + size])
        node = next(node for node in content["nodes"] if "mesh" in node)
        x, y, z = map(float, content["meshes"][node["mesh"]]["extras"]["rig:offset"])
        matrix = np.array(node["matrix"], np.float64).reshape(4, 4).T
    except (ValueError, KeyError, TypeError, IndexError, StopIteration, struct.error):
        return None
    return Placement(matrix, (x, y, z), Axes(z_up=False))


def _in_ply(path: Path) -> Placement | None:
    """PLY are not turned."""
    with path.open("rb") as file:
        head = file.read(1 << 16).partition(b"end_header")[0].decode("ascii", "replace")
    if not head.startswith("ply"):
        return None
    return offset_of(head.replace("comment ", "")) or less((0.0, 0.0, 0.0))


def offset_of(text: str) -> Placement | None:
    """Read the placement in the comments of a file of `rig export` (`stated_offset`), or return None."""
    offset = stated_offset(text)
    return None if offset is None else less(offset)

"""A camera of a USD stage, animated or not, read by usd-core."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from imaging.errors import InputError
from recon.rendering.cameras.camera_paths import CameraPath
from recon.rendering.cameras.given_camera import camera_of
from recon.rendering.cameras.placement import GivenPath, axes_of, open_stage, placement_in
from recon.rendering.request import MOST_FRAMES
from recon.scene.usd_field import SIZE, column_matrix, pinhole_numbers, times_of
from recon.splat import SplatCamera


def read_usd(path: Path, usual: SplatCamera, name: str | None) -> GivenPath:
    """Read a camera of a stage at each frame from the stage's first to its last, or without these from the
    first at which the camera moves to the last; those of `rig export` at theirs.

    name: of the camera or of its object, or its path; None: the first that `rig export` did not write, or
    else the first. The picture is as wide as that of the first view, and as high as the camera's aperture
    wants, unless the camera states its size. InputError if usd-core is missing, the file cannot be read, or
    the camera is missing.
    """
    from pxr import Usd, UsdGeom

    stage = open_stage(path)
    prim, note = _chosen(stage, path, name)
    camera = UsdGeom.Camera(prim)
    numbers = _frames(stage, camera)
    if len(numbers) > MOST_FRAMES:
        raise InputError(f"{path} has {len(numbers)} frames, more than {MOST_FRAMES}: export fewer.")
    times = [Usd.TimeCode(number) for number in numbers] or [Usd.TimeCode.Default()]
    cameras = [_camera(camera, time, usual, f"{prim.GetPath()} of {path}") for time in times]
    path_read = CameraPath(path.stem, tuple(cameras), tuple(numbers), note)
    return GivenPath(path_read, axes_of(stage), placement_in(stage, path))


def _frames(stage: Any, camera: Any) -> Sequence[int]:
    """The frames at which to draw a camera; none if it stands still and the stage names none.

    The range of a stage is that of its root layer: a layer below it may have moves without any.
    """
    from pxr import UsdGeom

    if camera.GetPrim().HasAttribute(SIZE):
        return [round(time) for time in UsdGeom.Xformable(camera).GetTimeSamples()]
    first, last = stage.GetStartTimeCode(), stage.GetEndTimeCode()
    if not stage.HasAuthoredTimeCodeRange() or last < first:
        times = times_of(camera)
        if not times:
            return []
        first, last = times[0], times[-1]
    start = int(np.ceil(first))
    return range(start, max(start, int(np.floor(last))) + 1)  # one frame at least of times between two


def _chosen(stage: Any, path: Path, name: str | None) -> tuple[Any, str]:
    """The prim of the camera to draw, and which it is, in words."""
    from pxr import UsdGeom

    prims = [prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Camera)]
    if not prims:
        raise InputError(f"{path} has no camera: export it with one.")
    if name is not None:
        prims = [prim for prim in prims if name in _names(prim)]
        if not prims:
            raise InputError(
                f"{path} has no camera {name!r:.60}: name one that it has, as its outliner does."
            )
    else:
        prims = [prim for prim in prims if not _exported(prim)] or prims
    others = f", the first of {len(prims)}" if len(prims) > 1 else ""
    return prims[0], f"camera {prims[0].GetPath()}{others}"


def _names(prim: Any) -> tuple[str, ...]:
    parent = prim.GetParent()
    return str(prim.GetPath()), prim.GetName(), prim.GetDisplayName(), parent.GetName()


def _exported(prim: Any) -> bool:
    """Return whether `rig export` wrote it, as the stage has it or as a program exported it again."""
    return prim.HasAttribute(SIZE) or "/World/Cameras/" in str(prim.GetPath())


def _camera(prim: Any, time: Any, usual: SplatCamera, where: str) -> SplatCamera:
    """Read the camera at a time; the matrices of Gf act on row vectors."""
    given = prim.GetCamera(time)
    if str(given.projection).endswith("Orthographic"):
        raise InputError(f"{where} is orthographic, which rig cannot draw: make it a perspective camera.")
    if not (given.horizontalAperture > 0 and given.verticalAperture > 0 and given.focalLength > 0):
        raise InputError(f"{where} has an aperture or a focal length of zero: correct it.")
    size = prim.GetPrim().GetAttribute(SIZE).Get(time) if prim.GetPrim().HasAttribute(SIZE) else None
    lens = pinhole_numbers(given, *(size or (usual.width, None)))
    return camera_of(column_matrix(given.transform), lens, where, opengl=True)

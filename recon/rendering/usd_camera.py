"""The camera of a USD stage, animated or not, read by usd-core."""

from pathlib import Path
from typing import Any

import numpy as np

from imaging.errors import InputError
from recon.rendering.camera_paths import MOST_FRAMES, CameraPath
from recon.rendering.given_camera import camera_of
from recon.splat import SplatCamera


def read_usd(path: Path, usual: SplatCamera) -> CameraPath:
    """The first camera of a stage, at each frame from the stage's first to its last.

    The picture is as wide as that of the first view, and as high as the camera's aperture wants. InputError
    if usd-core is missing, the file cannot be read, or there is no camera.
    """
    try:
        from pxr import Tf, Usd, UsdGeom
    except ImportError as error:
        raise InputError(
            f"{path} is read by usd-core, which is not installed: pip install 'hdr-rig[usd]', or export the "
            "camera as CSV."
        ) from error
    try:
        stage = Usd.Stage.Open(str(path))
    except Tf.ErrorException as error:
        raise InputError(f"{path} is damaged or not USD: export it again.") from error
    prims = [prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Camera)]
    if not prims:
        raise InputError(f"{path} has no camera: export it with one.")
    camera = UsdGeom.Camera(prims[0])
    first, last = stage.GetStartTimeCode(), stage.GetEndTimeCode()
    animated = stage.HasAuthoredTimeCodeRange() and last > first
    numbers = range(int(np.ceil(first)), int(np.floor(last)) + 1) if animated else range(0)
    if len(numbers) > MOST_FRAMES:
        raise InputError(f"{path} has {len(numbers)} frames, more than {MOST_FRAMES}: export fewer.")
    times = [Usd.TimeCode(number) for number in numbers] or [Usd.TimeCode.Default()]
    cameras = [_camera(camera.GetCamera(time), usual, f"{prims[0].GetPath()} of {path}") for time in times]
    return CameraPath(path.stem, tuple(cameras), tuple(numbers))


def _camera(given: Any, usual: SplatCamera, where: str) -> SplatCamera:
    """A GfCamera; its matrices act on row vectors, and lengths of its lens share one unit."""
    if str(given.projection).endswith("Orthographic"):
        raise InputError(f"{where} is orthographic, which rig cannot draw: make it a perspective camera.")
    across, down = float(given.horizontalAperture), float(given.verticalAperture)
    if not (across > 0 and down > 0):
        raise InputError(f"{where} has an aperture without size: correct it.")
    width = usual.width
    focal = float(given.focalLength) / across * width
    height = max(1, round(width * down / across))
    lens = {
        "width": width,
        "height": height,
        "fx": focal,
        "fy": focal,
        "cx": width / 2 - float(given.horizontalApertureOffset) / across * width,
        "cy": height / 2 + float(given.verticalApertureOffset) / down * height,
    }
    return camera_of(np.array(given.transform).T, lens, where, opengl=True)

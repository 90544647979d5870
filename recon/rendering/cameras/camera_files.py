"""Cameras of other programs' files, in the order of their frames, in the world of the calibration.

transforms.json of nerfstudio, Instant NGP and Blender scenes, a folder with a COLMAP model, a table (CSV),
and USD. Files of `rig export` say where the calibration lies in them, and so do stages of USD that were made
of theirs. Of other files somebody has to say it; else positions are taken as they are, as those of files that
`rig calibrate` writes have to be.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from imaging.errors import InputError
from imaging.files import store
from imaging.files.nerfstudio import DISTORTION, FISHEYE, Number, stated_centre, stated_focal, stated_terms
from imaging.natural_order import natural
from recon.rendering.cameras.camera_paths import CameraPath, lens_of_path
from recon.rendering.cameras.camera_table import read_table
from recon.rendering.cameras.given_camera import camera_of
from recon.rendering.cameras.placement import USD_SUFFIXES, GivenPath, less, offset_of, placement_of
from recon.rendering.request import MOST_FRAMES, check_path
from recon.result.scene import Scene
from recon.splat import SplatCamera

TRANSFORMS = "transforms.json"
OFFSET = "world_offset"
"""Key of the coordinates of a transforms.json of `rig export`: those of the calibration are the file's plus
this. (An `offset` is what they are less than those of a survey, and Instant NGP's.)"""
_NOT_READ = (
    "rolling_shutter", "transform_matrix_start", "transform_matrix_end", "from_mitsuba", "normal_mts_args",
    "latlong", "equirectangular", "orthographic", "ftheta_p0",
)  # fmt: skip
"""Keys of Instant NGP and nerfstudio by which a camera would be another one."""
_VIEWERS = {"camera_path": "nerfstudio", "path": "Instant NGP"}
"""Programs by the key of the cameras in the paths that their viewers write."""
_MOST = 1e9
"""Bound on the numbers of a lens."""
_COLMAP_MODELS = {
    "SIMPLE_PINHOLE": ("fx", "cx", "cy"),
    "PINHOLE": ("fx", "fy", "cx", "cy"),
    "SIMPLE_RADIAL": ("fx", "cx", "cy", "k1"),
    "RADIAL": ("fx", "cx", "cy", "k1", "k2"),
    "OPENCV": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"),
    "RADIAL_FISHEYE": ("fx", "cx", "cy", "k1", "k2"),
    "OPENCV_FISHEYE": ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4"),
}


def read_camera_path(
    path: Path, scene: Scene, *, within: Path | None = None, camera: str | None = None
) -> CameraPath:
    """The cameras of a file or folder, in the world of the calibration.

    Args:
        path: File transforms.json, a table (CSV) or a stage of USD; or a folder with a transforms.json or a
            COLMAP model.
        scene: Scene whose first view gives what the file does not say: size of the picture, focal length.
        within: File of `rig export` in whose coordinates the path is, unless it says that itself.
        camera: Name of the camera to take, where a stage of USD has several.

    Returns:
        The cameras, with a note on which camera of the file they are, and on the coordinates.

    Raises:
        InputError: A file cannot be read, or has no cameras or too many, and the message names the place in
            it; or a table states axes or a unit that `within` does not have.
    """
    given = _read(path, lens_of_path(scene.views), camera)
    path_read, placement = given.path, given.placement
    if not 1 <= len(path_read.cameras) <= MOST_FRAMES:
        raise InputError(f"{path} has {len(path_read.cameras)} cameras, not 1 to {MOST_FRAMES}: correct it.")
    coordinates = f"in the coordinates that {path} itself states"
    if placement is None and within is not None:
        placement, coordinates = placement_of(within), f"in the coordinates of {within}"
        if placement.axes is None and path.suffix.lower() == ".csv" and given.axes is not None:
            raise InputError(
                f"{path} says which axis is up or what a unit is, and {within} names neither: take the "
                "lines # up and # metersPerUnit out if the program has the numbers of that file, or name the "
                "USD or glb of rig export that it has."
            )
    if placement is None:
        coordinates = f"{path} states no coordinates: taken for those of the calibration"
    else:
        shifted = not scene.folder.is_file()  # else the world is that of the file
        moved = (placement.in_world(one, given.axes, shifted=shifted) for one in path_read.cameras)
        path_read = replace(path_read, cameras=tuple(moved))
    return replace(path_read, note=", ".join(filter(None, (path_read.note, coordinates))))


def _read(path: Path, usual: SplatCamera, camera: str | None) -> GivenPath:
    suffix = path.suffix.lower()
    if camera is not None and suffix not in USD_SUFFIXES:
        raise InputError(f"{path} has no cameras by name, as a stage of USD has: leave --path-camera out.")
    if path.is_dir():
        return _transforms(path / TRANSFORMS, usual) if (path / TRANSFORMS).is_file() else _colmap(path)
    check_path(path)
    if suffix == ".json":
        return _transforms(path, usual)
    if suffix == ".csv":
        return read_table(path, usual)
    if suffix in USD_SUFFIXES:
        from recon.rendering.cameras.usd_camera import read_usd

        return read_usd(path, usual, camera)
    what = "Alembic, which has no reader for Python" if suffix == ".abc" else "not a file of cameras"
    raise InputError(f"{path} is {what}: export the camera as USD or CSV, or name transforms.json.")


def _transforms(path: Path, usual: SplatCamera) -> GivenPath:
    """nerfstudio's; a frame overrides the top, which the first view's lens stands in for."""
    content = store.read_json(path)
    for key, program in _VIEWERS.items():
        if isinstance(content, dict) and isinstance(content.get(key), list):
            raise InputError(
                f"{path} is a camera path of {program}'s viewer, in coordinates of its own training: give "
                "cameras as transforms.json, USD or CSV."
            )
    frames = content.get("frames") if isinstance(content, dict) else None
    if not isinstance(frames, list) or not all(isinstance(frame, dict) for frame in frames):
        raise InputError(f"{path} has no list of frames: export it again.")
    cameras = []
    for index, frame in enumerate(frames):
        where = f"frame {index} of {path}"
        for key in _NOT_READ:
            if _says({**content, **frame}.get(key)):
                raise InputError(
                    f"{where} has a {key}, which rig does not support: export it again without it."
                )
        lens = _nerfstudio_lens(frame, content, usual, where)
        cameras.append(camera_of(frame.get("transform_matrix"), lens, where, opengl=True))
    coordinates = content.get("coordinates")
    offset = coordinates.get(OFFSET) if isinstance(coordinates, dict) else None
    if offset is None:
        return GivenPath(CameraPath(path.stem, tuple(cameras)))
    numbers = offset if isinstance(offset, list) else []
    if len(numbers) != 3 or not all(isinstance(one, int | float) and math.isfinite(one) for one in numbers):
        raise InputError(f"{path} has a {OFFSET} that is not three numbers: export it again.")
    return GivenPath(CameraPath(path.stem, tuple(cameras)), None, less(numbers))


def _says(value: object) -> bool:
    """Return whether the value of a key says anything: no list of zeros, and not false."""
    return any(map(bool, value)) if isinstance(value, list) else value is not None and value is not False


def _numbers(values: Mapping[str, Any], where: str) -> Number:
    """The numbers that keys state; InputError for other values, or too large ones."""

    def number(key: str) -> float | None:
        value, terms = values.get(key), values.get("distortion_params")
        if terms is not None and key in DISTORTION:
            if not isinstance(terms, list) or len(terms) != len(DISTORTION):
                raise InputError(f"{where} has a distortion_params that is not 6 numbers: correct it.")
            value = terms[DISTORTION.index(key)]
        if value is None:
            return None
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < _MOST:
            raise InputError(f"{where} has a {key} that is not a number, or too large: correct it.")
        return float(value)

    return number


def _nerfstudio_lens(
    frame: Mapping[str, Any], top: Mapping[str, Any], usual: SplatCamera, where: str
) -> dict[str, Any]:
    values = {**top, **frame}
    number = _numbers(values, where)
    model = values.get("camera_model", FISHEYE if values.get("is_fisheye") else "OPENCV")
    if model not in (*_COLMAP_MODELS, None):
        raise InputError(f"{where} has a camera_model {model!r:.40}, which rig cannot draw: use OPENCV.")
    fisheye = "FISHEYE" in (model or "")
    width, height = int(number("w") or usual.width), int(number("h") or usual.height)
    levels = [_numbers(level, where) for level in (frame, top)]
    focal = stated_focal(levels, width, height, where, fisheye=fisheye)
    angles = ("camera_angle_x", "camera_angle_y", "x_fov", "y_fov")
    if focal is None and fisheye and any(map(number, angles)):
        raise InputError(f"{where} has the field of view of a fisheye, not its focal length: write fl_x.")
    stands_in = usual.fx * width / usual.width
    fx, fy = focal or (stands_in, stands_in)
    terms, others = stated_terms(number, fisheye=fisheye)
    if others:
        raise InputError(f"{where} has a lens with {others[0]}, which rig cannot draw: take it out.")
    cx, cy = stated_centre(number, width, height)
    return {
        "width": width, "height": height, "fx": fx, "fy": fy, "cx": cx, "cy": cy, "fisheye": fisheye, **terms
    }  # fmt: skip


def _colmap(folder: Path) -> GivenPath:
    """The images of a model by name, with their own lenses."""
    from imaging.files.colmap import read_model

    try:
        model = read_model(folder)
    except InputError as error:
        raise InputError(
            f"{folder} has neither {TRANSFORMS} nor the cameras, images and points3D of a COLMAP model: name "
            "the folder that has."
        ) from error
    cameras = []
    for image in sorted(model.images.values(), key=lambda image: natural(PurePosixPath(image.name))):
        camera, where = image.camera, f"image {image.name} of {folder}"
        names = _COLMAP_MODELS.get(camera.model_name)
        if names is None:
            raise InputError(f"{where} has a lens {camera.model_name}, which rig cannot draw: use OPENCV.")
        lens = dict(zip(names, map(float, camera.params), strict=True))
        lens.setdefault("fy", lens["fx"])
        size = {"width": int(camera.width), "height": int(camera.height)}
        pose = np.vstack([image.cam_from_world().inverse().matrix(), [0, 0, 0, 1]])
        fisheye = "FISHEYE" in camera.model_name
        cameras.append(camera_of(pose, {**lens, **size, "fisheye": fisheye}, where, opengl=False))
    path_read = CameraPath(folder.resolve().name, tuple(cameras))
    images = folder / "images.txt"
    if not images.is_file() or (folder / "images.bin").is_file():
        return GivenPath(path_read)
    first = images.read_text("utf-8", "replace").partition("\n")[0]
    return GivenPath(path_read, None, offset_of(first.removeprefix("# ")))

"""Cameras of other programs' files, in the order of their frames, in the world of the calibration.

transforms.json of nerfstudio, Instant NGP and Blender scenes, a folder with a COLMAP model, a table (CSV),
and USD. Positions are taken as they are: they have to be in the coordinates of the scene, as those of files
that `rig calibrate` writes are.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from imaging.errors import InputError
from imaging.files import store
from recon.rendering.camera_paths import MOST_FRAMES, CameraPath, lens_of_path
from recon.rendering.camera_table import read_table
from recon.rendering.given_camera import camera_of
from recon.result.scene import Scene
from recon.splat import SplatCamera

TRANSFORMS = "transforms.json"
USD_SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
_COLMAP_MODELS = {
    "SIMPLE_PINHOLE": ("fx", "cx", "cy"),
    "PINHOLE": ("fx", "fy", "cx", "cy"),
    "SIMPLE_RADIAL": ("fx", "cx", "cy", "k1"),
    "RADIAL": ("fx", "cx", "cy", "k1", "k2"),
    "OPENCV": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"),
    "RADIAL_FISHEYE": ("fx", "cx", "cy", "k1", "k2"),
    "OPENCV_FISHEYE": ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4"),
}


def read_camera_path(path: Path, scene: Scene) -> CameraPath:
    """The cameras of a file or folder; InputError, naming the place in it, for what cannot be read.

    What it says nothing of is taken from the first view: size of the picture, focal length.
    """
    usual = lens_of_path(scene.views)
    suffix = path.suffix.lower()
    if path.is_dir():
        found = _transforms(path / TRANSFORMS, usual) if (path / TRANSFORMS).is_file() else _colmap(path)
    elif not path.is_file():
        raise InputError(
            f"{path} is no path to render: write orbit:N, spline:N, or name transforms.json, a folder with a "
            "COLMAP model, a CSV table or a USD file."
        )
    elif suffix == ".json":
        found = _transforms(path, usual)
    elif suffix == ".csv":
        found = read_table(path, usual)
    elif suffix in USD_SUFFIXES:
        from recon.rendering.usd_camera import read_usd

        found = read_usd(path, usual)
    else:
        what = "Alembic, which has no reader for Python" if suffix == ".abc" else "no file of cameras"
        raise InputError(f"{path} is {what}: export the camera as USD or CSV, or name transforms.json.")
    if not 1 <= len(found.cameras) <= MOST_FRAMES:
        raise InputError(f"{path} has {len(found.cameras)} cameras, not 1 to {MOST_FRAMES}: correct it.")
    return found


def _transforms(path: Path, usual: SplatCamera) -> CameraPath:
    """nerfstudio's; a frame overrides the top, which the first view's lens stands in for."""
    content = store.read_json(path)
    frames = content.get("frames") if isinstance(content, dict) else None
    if not isinstance(frames, list) or not all(isinstance(frame, dict) for frame in frames):
        raise InputError(f"{path} has no list of frames: export it again.")
    cameras = []
    for index, frame in enumerate(frames):
        where = f"frame {index} of {path}"
        lens = _nerfstudio_lens({**content, **frame}, usual, where)
        cameras.append(camera_of(frame.get("transform_matrix"), lens, where, opengl=True))
    return CameraPath(path.stem, tuple(cameras))


def _nerfstudio_lens(values: Mapping[str, Any], usual: SplatCamera, where: str) -> dict[str, Any]:
    def number(key: str) -> float | None:
        value = values.get(key)
        if value is not None and (isinstance(value, bool) or not isinstance(value, int | float)):
            raise InputError(f"{where} has a {key} that is no number: correct it.")
        return value

    model = values.get("camera_model", "OPENCV_FISHEYE" if values.get("is_fisheye") else "OPENCV")
    if model not in (*_COLMAP_MODELS, None):
        raise InputError(f"{where} has a camera_model {model!r:.40}, which rig cannot draw: use OPENCV.")
    fisheye = "FISHEYE" in (model or "")
    width, height = int(number("w") or usual.width), int(number("h") or usual.height)
    across, down = (number(f"camera_angle_{axis}") for axis in "xy")
    fx = number("fl_x") or (across and width / 2 / math.tan(across / 2))
    fy = number("fl_y") or (down and height / 2 / math.tan(down / 2))
    focal = fx or fy or usual.fx * width / usual.width
    terms = ("k1", "k2", "k3", "k4") if fisheye else ("k1", "k2", "p1", "p2")
    cx, cy = number("cx"), number("cy")
    return {
        "width": width,
        "height": height,
        "fx": fx or focal,
        "fy": fy or focal,
        "cx": width / 2 if cx is None else cx,
        "cy": height / 2 if cy is None else cy,
        "fisheye": fisheye,
        **{term: number(term) or 0.0 for term in terms},
    }


def _colmap(folder: Path) -> CameraPath:
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
    for image in sorted(model.images.values(), key=lambda image: str(image.name)):
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
    return CameraPath(folder.resolve().name, tuple(cameras))

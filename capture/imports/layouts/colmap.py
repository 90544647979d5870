"""A COLMAP project: `images/` beside `sparse/0/` with cameras, images and points3D (.bin or .txt)."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from capture.imports.layouts.colmap_files import check_whole
from capture.imports.layouts.given import Given, GivenPhoto, lens_of, pose_of
from capture.imports.masks import masks_beside
from capture.imports.originals import natural, pictures_in, shown
from imaging.compute.memory import check
from imaging.errors import InputError
from imaging.files import store
from imaging.files.colmap import pycolmap
from imaging.lens import Lens, LensModel
from imaging.pose import Pose

MODELS: Mapping[str, LensModel] = {
    "SIMPLE_PINHOLE": "PINHOLE",
    "PINHOLE": "PINHOLE",
    "SIMPLE_RADIAL": "SIMPLE_RADIAL",
    "RADIAL": "RADIAL",
    "OPENCV": "OPENCV",
    "SIMPLE_FISHEYE": "OPENCV_FISHEYE",
    "FISHEYE": "OPENCV_FISHEYE",
    "SIMPLE_RADIAL_FISHEYE": "OPENCV_FISHEYE",
    "RADIAL_FISHEYE": "OPENCV_FISHEYE",
    "OPENCV_FISHEYE": "OPENCV_FISHEYE",
}
"""COLMAP's camera models that rig has a lens for."""

_PER_BYTE = 4
"""Bytes of memory that pycolmap takes for each of a model's files."""


def model_folder(folder: Path) -> Path | None:
    """Where the sparse model of a project lies; None if the folder has none."""
    for place in (folder / "sparse" / "0", folder / "sparse"):
        if any((place / f"cameras.{kind}").is_file() for kind in ("bin", "txt")):
            return place
    return None


def images_folder(folder: Path) -> Path:
    """Where the photographs lie that the model names: `images/`, else the folder itself."""
    images = folder / "images"
    return images if images.is_dir() else folder


def read(folder: Path) -> Given:
    """The photographs of a project; those that the model does not name come without a pose.

    InputError if there is no model or it is damaged. A camera of a model that rig has no lens for
    leaves its photographs without lens and pose, and a note says so.
    """
    place = model_folder(folder)
    if place is None:
        raise InputError(f"{folder} has no sparse/0 with cameras.bin or cameras.txt: use --layout photos.")
    model = read_model(place)
    root = images_folder(folder)
    notes, missing = [], []
    lenses = {key: lens_of_camera(camera, place) for key, camera in sorted(model.cameras.items())}
    unfit = {model.cameras[key].model_name for key, lens in lenses.items() if lens is None}
    if unfit:
        notes.append(
            f"Cameras of the model {' and '.join(sorted(unfit))} come without lens and poses, since rig has "
            "no such lens: undistort the images first if the poses matter."
        )
    others = [path.name for path in sorted(place.parent.iterdir()) if path.is_dir() and path != place]
    if place.name == "0" and others:
        notes.append(f"Only sparse/0 is read; the photos of sparse/{', sparse/'.join(others)} have no poses.")
    masks = {}
    if root != folder:  # else they would be photographs of the project
        masks = masks_beside(pictures_in(root), root, folder / "masks")
    rigs = _rigs(model, place)
    frames = _frames(model) if rigs else {}
    photos: dict[Path, GivenPhoto] = {}
    for key, image in sorted(model.images.items(), key=lambda item: natural(Path(item[1].name))):
        path = store.inside(root, image.name)
        if path in photos:
            raise InputError(f"{place} names {shown(path)} twice: take one of both out.")
        if not path.is_file():
            missing.append(f"{shown(path)} is named in {place} but is not there")
            continue
        lens = lenses[image.camera_id]
        pose = pose_of_image(image, place) if lens is not None and image.has_pose else None
        mask = masks.get(path)
        photos[path] = GivenPhoto(path, str(image.camera_id), lens, pose, frame=frames.get(key), mask=mask)
    rest = [path for path in pictures_in(root) if path not in photos] if root.name == "images" else []
    if rest:
        count = "1 photo" if len(rest) == 1 else f"{len(rest)} photos"
        notes.append(f"{count} that {place} has no pose for: rig calibrate may find it.")
        photos |= {
            path: GivenPhoto(path, _camera_beside(path, photos), mask=masks.get(path)) for path in rest
        }
    return Given(
        "colmap",
        place,
        tuple(photos.values()),
        model=place,
        images=root,
        rigs=rigs,
        missing=tuple(missing),
        notes=tuple(notes),
    )


def read_model(place: Path) -> Any:
    """The pycolmap reconstruction of a model folder; InputError if it is damaged."""
    size = sum(path.stat().st_size for path in place.iterdir() if path.suffix in (".bin", ".txt"))
    check(f"{place} is a COLMAP model of {size / 1e6:.0f} MB", _PER_BYTE * size)
    check_whole(place)
    try:
        model = pycolmap.Reconstruction(str(place))
        for image in model.images.values():
            image.name.encode()  # raises for a name that is no UTF-8
    except Exception as error:  # of many types, one for each way in which a file may be wrong
        raise InputError(f"{place} cannot be read as a COLMAP model: export it again.") from error
    return model


def lens_of_camera(camera: Any, place: Path) -> Lens | None:
    """The lens of a COLMAP camera; None if its model is none that rig has."""
    model = MODELS.get(camera.model_name)
    if model is None:
        return None
    names = [name.strip() for name in camera.params_info.split(",")]
    values = dict(zip(names, (float(value) for value in camera.params), strict=True))
    focal = values.pop("f", None)
    if focal is not None:
        values |= {"fx": focal, "fy": focal}
    if "k" in values:
        values["k1"] = values.pop("k")
    size = (int(camera.width), int(camera.height))
    return lens_of(model, size, values, f"camera {camera.camera_id} of {place}")


def pose_of_image(image: Any, place: Path) -> Pose:
    """Where an image of a COLMAP model was taken from."""
    motion = np.eye(4)
    motion[:3] = np.asarray(image.cam_from_world().matrix())
    return pose_of(motion, f"{image.name} in {place}")


def _camera_beside(path: Path, photos: Mapping[Path, GivenPhoto]) -> str:
    """The camera of the other photographs of a folder, if they are all of one; else one of its own."""
    cameras = {photo.camera for other, photo in photos.items() if other.parent == path.parent}
    return cameras.pop() if len(cameras) == 1 else "unknown"


def _rigs(model: Any, place: Path) -> dict[str, tuple[str, Pose]]:
    """Rig and `cam_from_rig` of the cameras that share a rig with another."""
    rigs: dict[str, tuple[str, Pose]] = {}
    for key, rig in sorted(model.rigs.items()):
        if rig.num_sensors() < 2:
            continue
        motions = {rig.ref_sensor_id.id: np.eye(4)}
        for sensor, motion in rig.non_ref_sensors.items():
            if motion is not None:
                motions[sensor.id] = np.vstack([np.asarray(motion.matrix()), [0.0, 0.0, 0.0, 1.0]])
        for camera, motion in motions.items():
            rigs[str(camera)] = (f"rig{key}", pose_of(motion, f"camera {camera} of {place}"))
    return rigs


def _frames(model: Any) -> dict[int, int]:
    """The frame, from 0, of every image of a model with rigs."""
    number = {key: index for index, key in enumerate(sorted(model.frames))}
    return {key: number[image.frame_id] for key, image in model.images.items()}

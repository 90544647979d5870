"""A COLMAP project: `images/` beside `sparse/0/` with cameras, images and points3D (.bin or .txt)."""

from collections.abc import Iterable, Mapping
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from capture.imports.given.masks import masks_beside
from capture.imports.layouts.colmap_files import read_model
from capture.imports.layouts.given import Given, GivenPhoto, lens_of, pose_of
from capture.imports.layouts.named_files import file_named
from capture.imports.layouts.nearest_lens import nearest_lens
from capture.imports.originals import aside_notes, pictures_in, shown
from capture.imports.sorting.derived import Derived, find_derived
from capture.pictures.read import kind_of
from imaging.and_list import and_list
from imaging.arrays import Array
from imaging.errors import InputError
from imaging.natural_order import natural
from imaging.optics.lens import Lens, LensModel
from imaging.optics.pose import Pose

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

_DEEPEST = 3
"""Steps below the folder in which a model is looked for."""
_SAMPLE = 200
"""Images of a model by which the folder of its photographs is known."""


def model_folder(folder: Path) -> Path | None:
    """Return where the sparse model of a project lies; None if the folder has none.

    Where COLMAP, nerfstudio and 3DGS put it, else in the first folder of a project that holds one.
    """
    usual = usual_model_folder(folder)
    if usual is not None:
        return usual
    for relative in ("colmap/sparse/0", "dense/sparse", "dense/0/sparse"):
        if _is_model(folder / relative):
            return folder / relative
    places = [folder, *(path for depth in range(1, _DEEPEST + 1) for path in _folders(folder, depth))]
    return next((place for place in places if _is_model(place)), None)


def usual_model_folder(folder: Path) -> Path | None:
    """Return where the model lies if it is where COLMAP writes it, `sparse/0` or `sparse`."""
    return next((p for p in (folder / "sparse" / "0", folder / "sparse") if _is_model(p)), None)


def _is_model(place: Path) -> bool:
    return any((place / f"cameras.{kind}").is_file() for kind in ("bin", "txt")) and any(
        (place / f"images.{kind}").is_file() for kind in ("bin", "txt")
    )


def _folders(folder: Path, depth: int) -> list[Path]:
    """Subfolders at that depth, in natural order; hidden ones and links are passed over."""
    folders = [
        path
        for path in folder.glob("/".join("*" * depth))
        if path.is_dir()
        and not path.is_symlink()
        and not any(part.startswith(".") for part in path.relative_to(folder).parts)
    ]
    return sorted(folders, key=lambda path: natural(path.relative_to(folder)))


def images_folder(folder: Path, names: Iterable[str] = ()) -> Path:
    """Folder of the photographs that a model names: the one that has most of them, `images/` first."""
    place = model_folder(folder)
    above = [] if place is None else [path for path in place.parents if path.is_relative_to(folder)]
    roots = [root / name for root in (folder, *above) for name in ("images", "input", ".")]
    there = [root for root in dict.fromkeys(roots) if root.is_dir()]
    some = list(islice(names, _SAMPLE))
    images = folder / "images"
    best = max(there, key=lambda root: sum(_named(root, name).is_file() for name in some))
    if images.is_dir() and not any(_named(best, name).is_file() for name in some):
        return images
    return folder if best == folder / "." else best


def _named(root: Path, name: str) -> Path:
    """The file of an image of a model; a path that is no file where its name leads out of the folder."""
    try:
        return file_named(root, name)
    except InputError:
        return root


def read(folder: Path) -> Given:
    """The photographs of a project; those that the model does not name come without a pose.

    InputError if there is no model or it is damaged. A camera of a model that rig has no lens for
    leaves its photographs without lens and pose, and a note says so.
    """
    place = model_folder(folder)
    if place is None:
        raise InputError(f"{folder} has no sparse/0 with cameras.bin or cameras.txt: use --layout photos.")
    model = read_model(place)
    root = images_folder(folder, (image.name for _, image in sorted(model.images.items())))
    lenses = {key: lens_of_camera(camera, place) for key, camera in sorted(model.cameras.items())}
    notes, missing = _lens_notes(model, lenses), []
    others = [path.name for path in sorted(place.parent.iterdir()) if path.is_dir() and path != place]
    if place.name == "0" and others:
        notes.append(f"Only sparse/0 is read; the photos of sparse/{', sparse/'.join(others)} have no poses.")
    pictures = pictures_in(root)
    derived = find_derived(root, pictures)
    masks = dict(derived.masks)
    if root != folder:  # else they would be photographs of the project
        masks |= masks_beside(pictures, root, folder / "masks")
    rigs = _rigs(model, place)
    frames = _frames(model) if rigs else {}
    photos: dict[Path, GivenPhoto] = {}
    for key, image in sorted(model.images.items(), key=lambda item: natural(Path(item[1].name))):
        path = file_named(root, image.name)
        if path in photos:
            raise InputError(f"{place} names {shown(path)} twice: take one of both out.")
        if not path.is_file():
            missing.append(f"{shown(path)} is named in {place} but does not exist")
            continue
        lens = lenses[image.camera_id]
        pose = pose_of_image(image, place) if lens is not None and image.has_pose else None
        mask = masks.get(path)
        photos[path] = GivenPhoto(path, str(image.camera_id), lens, pose, frame=frames.get(key), mask=mask)
    rest: list[Path] = []
    if root.name == "images":
        rest, aside = _unnamed(folder, pictures, photos, derived)
        notes += aside
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


def _lens_notes(model: Any, lenses: Mapping[int, Lens | None]) -> list[str]:
    """Sentences on the cameras that come without a lens, and on those with the nearest."""
    notes = []
    unfit = {model.cameras[key].model_name for key, lens in lenses.items() if lens is None}
    if unfit:
        notes.append(
            f"Cameras of the model {and_list(sorted(unfit))} come without lens and poses, since no lens "
            "of rig is like theirs: undistort the images first if the poses matter."
        )
    near = {camera.model_name for camera in model.cameras.values()} - MODELS.keys() - unfit
    if near:
        notes.append(
            f"Lenses of the model {and_list(sorted(near))} become the nearest that rig has, which differ "
            "by less than a pixel anywhere."
        )
    return notes


def _unnamed(
    folder: Path, pictures: Iterable[Path], photos: Iterable[Path], derived: Derived
) -> tuple[list[Path], list[str]]:
    """The photographs that a model does not name, and sentences on what is left aside.

    A file beside a photograph of the model with its name, as the RAW file that it was developed from, is
    the same view. RAW+JPEG pairs are one view, too, of which the file counts that is as those of the model.
    """
    posed = set(photos)
    named = {(path.parent, path.stem.casefold()) for path in posed}
    aside = {path for group in derived.aside.values() for path in group}
    rest: list[Path] = []
    skipped: dict[Path, list[Path]] = {}
    twins = 0
    for path in pictures:
        if path in posed:
            continue
        if (path.parent, path.stem.casefold()) in named:
            twins += 1
        elif path in aside:
            skipped.setdefault(path.parent, []).append(path)
        else:
            rest.append(path)
    notes = aside_notes(folder, skipped)
    second, counts = ("raw", "ldr") if {kind_of(path) for path in posed} == {"ldr"} else ("ldr", "raw")
    first = {(path.parent, path.stem.casefold()) for path in rest if kind_of(path) == counts}
    pairs = {p for p in rest if kind_of(p) == second and (p.parent, p.stem.casefold()) in first}
    if pairs:
        rest = [path for path in rest if path not in pairs]
        count = "1 file is" if len(pairs) == 1 else f"{len(pairs)} files are"
        notes.append(f"{count} left aside beside photos of the same name, which have no poses.")
    if twins:
        count = "1 file is" if twins == 1 else f"{twins} files are"
        notes.append(f"{count} left aside beside photos of the same name, which have poses.")
    return rest, notes


def lens_of_camera(camera: Any, place: Path) -> Lens | None:
    """Lens of a COLMAP camera; None if rig has no such model."""
    model = MODELS.get(camera.model_name)
    if model is None:
        return _nearest(camera, place)
    names = [name.strip() for name in camera.params_info.split(",")]
    values = dict(zip(names, (float(value) for value in camera.params), strict=True))
    focal = values.pop("f", None)
    if focal is not None:
        values |= {"fx": focal, "fy": focal}
    if "k" in values:
        values["k1"] = values.pop("k")
    size = (int(camera.width), int(camera.height))
    return lens_of(model, size, values, f"camera {camera.camera_id} of {place}")


def _nearest(camera: Any, place: Path) -> Lens | None:
    """The lens of `rig` nearest to a camera of a model that it has not; None where none is near."""
    if not camera.focal_length_idxs():  # of a panorama, of which pycolmap would end the process
        return None

    def image_of(tangents: Array) -> Array:
        rays = np.concatenate([tangents, np.ones((len(tangents), 1))], axis=1)
        pixels = camera.img_from_cam(rays)
        return np.full(tangents.shape, np.nan) if pixels is None else np.asarray(pixels, np.float64)

    try:
        centred = (
            float(camera.focal_length_x),
            float(camera.focal_length_y),
            float(camera.principal_point_x),
            float(camera.principal_point_y),
        )
        size = (int(camera.width), int(camera.height))
        return nearest_lens(image_of, size, centred, f"camera {camera.camera_id} of {place}")[0]
    except (RuntimeError, ValueError, TypeError, IndexError):  # a model that has no such rays
        return None


def pose_of_image(image: Any, place: Path) -> Pose:
    """Return where an image of a COLMAP model was taken from."""
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

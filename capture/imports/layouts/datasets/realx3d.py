"""RealX3D's layout (Liu et al., arXiv 2512.23437): a scene under one of nine conditions, and its references.

`train/` holds the degraded photographs, `val/` clean ones of the same names and poses, `test/` clean ones of
other poses. `transforms_train.json`, `transforms_val.json` and `transforms_test.json` list them; their poses
are in a rescaled world, so lenses and poses are those of the COLMAP model in `sparse/0`, which names the
photographs without a folder. The similarity to metres and the laser's depth maps are of all conditions of a
scene, in `pointclouds/SCENE` beside `data/CONDITION/SCENE` or `data_4/CONDITION/SCENE`.

The photographs of `val/` are not imported: they would show training what it has to restore.
"""

from pathlib import Path
from typing import Literal

from capture.imports.layouts import colmap
from capture.imports.layouts.colmap_files import read_model
from capture.imports.layouts.given import Given, GivenPhoto
from capture.imports.layouts.nerfstudio import entries
from capture.imports.originals import shown
from imaging.errors import InputError

PARTS = ("train", "val", "test")
_USED: tuple[Literal["train", "test"], ...] = ("train", "test")


def is_one(folder: Path) -> bool:
    """Return whether a folder has a model, the three lists, and a reference of each training photograph."""
    listed = all(
        (folder / f"transforms_{part}.json").is_file() and (folder / part).is_dir() for part in PARTS
    )
    if not listed or colmap.usual_model_folder(folder) is None:
        return False
    degraded, clean = ({path.name for path in (folder / part).iterdir()} for part in ("train", "val"))
    return bool(degraded) and degraded <= clean


def read(folder: Path) -> Given:
    """The photographs to train on and to test on, each a frame of its own.

    InputError if a list or the model is missing or damaged, or two lists name one photograph.
    """
    place = colmap.usual_model_folder(folder)
    if place is None:
        raise InputError(f"{folder} has no COLMAP model in sparse/0: copy it there.")
    model = read_model(place)
    lenses = {key: colmap.lens_of_camera(camera, place) for key, camera in model.cameras.items()}
    images = {Path(image.name).name: image for image in model.images.values()}
    photos: list[GivenPhoto] = []
    developed: dict[str, Path] = {}
    missing: list[str] = []
    for use in _USED:
        for entry in entries(folder / f"transforms_{use}.json"):
            path = folder / use / Path(entry.file_path).name
            image = images.get(path.name)
            if not path.is_file():
                missing.append(f"{shown(path)} is named in {entry.where} but does not exist")
                continue
            if image is None:
                raise InputError(
                    f"{entry.where} names {shown(path)}, which {place} has no pose for: copy both again."
                )
            if image.name in developed:
                raise InputError(f"{entry.where} names {shown(path)} a second time: take one of both out.")
            developed[image.name] = path
            lens = lenses[image.camera_id]
            pose = colmap.pose_of_image(image, place) if lens is not None and image.has_pose else None
            photos.append(GivenPhoto(path, str(image.camera_id), lens, pose, frame=len(photos), use=use))
    return Given(
        "realx3d",
        place,
        tuple(photos),
        model=place,
        images=folder / "train",
        developed=developed,
        missing=tuple(missing),
        notes=(
            "The clean photographs of val/ are not imported, since they are references of those in train/.",
        ),
    )

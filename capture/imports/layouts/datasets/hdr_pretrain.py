"""HDR-Pretrain's layout (Ye et al., InstantHDR, arXiv 2603.11298): rendered views in five exposures each.

By the authors' `docs/data.md`: a scene holds `images/PART_ldr_NNN_E.png` (or `PART_r_N_E.png`), where PART is
`train` or `test` and E the index of the exposure; `exposure.json`, linear times by file name; a COLMAP model
in `sparse/0` with one image for all exposures of a view; and `images_hdr/PART_hdr_NNN.exr`, the true light.
The maps in `depth/` and `normal/` are not read, since no unit or format of theirs is stated.
"""

import math
import re
from collections import defaultdict
from pathlib import Path
from typing import Literal

from capture.imports.layouts import colmap
from capture.imports.layouts.colmap_files import read_model
from capture.imports.layouts.given import Given, GivenPhoto
from capture.imports.originals import pictures_in, shown
from imaging.errors import InputError
from imaging.files import store
from imaging.optics.exposure import Exposure

EXPOSURES = "exposure.json"
_NAME = re.compile(r"(train|test)_(?:ldr|r)_(\d+)_(\d+)")
_View = tuple[str, int]


def is_one(folder: Path) -> bool:
    """Return whether a folder has the times, a model, and photographs with names of exposures."""
    return (
        (folder / EXPOSURES).is_file()
        and colmap.usual_model_folder(folder) is not None
        and any(_NAME.fullmatch(path.stem) for path in pictures_in(folder / "images"))
    )


def read(folder: Path) -> Given:
    """The photographs of a scene, the exposures of a view as one frame.

    InputError if there is no model, or a time, a name or a view's pose is missing or damaged.
    """
    place = colmap.usual_model_folder(folder)
    if place is None:
        raise InputError(f"{folder} has no COLMAP model in sparse/0: copy it there.")
    model = read_model(place)
    lenses = {key: colmap.lens_of_camera(camera, place) for key, camera in model.cameras.items()}
    images = {_view_of(Path(image.name), place)[0]: image for image in model.images.values()}
    times = _times(folder / EXPOSURES)
    photos: list[GivenPhoto] = []
    truth: dict[int, Path] = {}
    for frame, (view, group) in enumerate(sorted(_groups(folder).items())):
        image = images.get(view)
        if image is None:
            raise InputError(
                f"{place} has no pose for {shown(group[0])}: copy both again or use --layout colmap."
            )
        lens = lenses[image.camera_id]
        pose = colmap.pose_of_image(image, place) if lens is not None and image.has_pose else None
        use: Literal["train", "test"] = "train" if view[0] == "train" else "test"
        for path in group:
            if path.name not in times:
                raise InputError(f"{folder / EXPOSURES} has no time for {shown(path)}: copy it again.")
            exposure = Exposure(time=times[path.name])
            photos.append(GivenPhoto(path, str(image.camera_id), lens, pose, exposure, frame, use))
        light = folder / "images_hdr" / f"{view[0]}_hdr_{view[1]:03d}.exr"
        if light.is_file():
            truth[frame] = light
    there = {photo.path.name for photo in photos}
    missing = [
        f"{shown(folder / 'images' / name)} is named in {folder / EXPOSURES} but does not exist"
        for name in times
        if name not in there
    ]
    return Given(
        "hdr-pretrain",
        place,
        tuple(photos),
        model=place,
        images=folder / "images",
        truth=truth,
        missing=tuple(missing),
    )


def _groups(folder: Path) -> dict[_View, list[Path]]:
    """The exposures of each view, by their index."""
    views: dict[_View, list[tuple[int, Path]]] = defaultdict(list)
    for path in pictures_in(folder / "images"):
        view, step = _view_of(path, folder / "images")
        views[view].append((step, path))
    return {view: [path for _, path in sorted(group)] for view, group in views.items()}


def _view_of(path: Path, where: Path) -> tuple[_View, int]:
    """Part and number of the view of an image, and the index of its exposure."""
    match = _NAME.fullmatch(path.stem)
    if match is None:
        raise InputError(
            f"{where} has {shown(path)}, not named train_ldr_000_0 or so: move it away or use "
            "--layout colmap."
        )
    return (match[1], int(match[2])), int(match[3])


def _times(path: Path) -> dict[str, float]:
    """Linear times by file name; InputError unless all are positive numbers."""
    value = store.read_json(path)
    if not isinstance(value, dict):
        raise InputError(f"{path} does not give a time for each photograph: copy it again.")
    for name, time in value.items():
        number = isinstance(time, int | float) and not isinstance(time, bool)
        if not (number and math.isfinite(time) and time > 0):
            raise InputError(f"{path} gives {name!r} the time {time!r}, not a positive number: correct it.")
    return {str(name): float(time) for name, time in value.items()}

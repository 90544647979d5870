"""The layouts of HDR-NeRF (Huang et al., CVPR 2022): several exposures of every view, and their times.

Photographs are named `<view>_<index of the exposure>.png` (or .jpg). Three forms are about:

* rendered scenes: `transforms_train.json` and `transforms_test.json` as Blender scenes have them, with
  `exposure_train.json` and `exposure_test.json`, seconds by file name; true light in `test_hdr/hdr_NNN.exr`;
* photographed scenes: `input_images/` and `poses_bounds_exps.npy` [N, 18], a row for each photograph
  in order of names: LLFF's 3x5 pose (columns down, right, back, centre, and height, width, focal
  length), two depths, and the exposure in seconds;
* both as HDR-GS (Cai et al., NeurIPS 2024) hands them on: a COLMAP model of one exposure of every
  view in `sparse/0`, photographs in `images/` or `input_images/`, true light in `exr/<view>.exr`.

Every other view is for testing, in all its exposures; of the others t1, t3 and t5 are for training. The first
form says which views are which, the other two leave it to their order by name, as text.
"""

import math
import re
from pathlib import Path
from typing import Any, Literal

from capture.imports.layouts import colmap
from capture.imports.layouts.colmap_files import read_model
from capture.imports.layouts.given import Given, GivenPhoto
from capture.imports.layouts.llff import lens_of_rows, pose_of_row, read_rows
from capture.imports.layouts.nerfstudio import entries
from capture.imports.layouts.posed_frame import PosedFrame
from capture.imports.originals import pictures_in, shown
from capture.imports.request import LayoutName
from capture.pictures.read import kind_of
from imaging.errors import InputError
from imaging.files import store
from imaging.optics.exposure import Exposure
from imaging.optics.lens import Lens
from imaging.optics.pose import Pose

ARRAY = "poses_bounds_exps.npy"
COLUMNS = 18

RENDERED_TIMES = (0.125, 0.5, 2.0, 8.0, 32.0)
"""Seconds; of the rendered scenes in the form of HDR-GS, which states them in its code alone."""

_FOLDERS = ("input_images", "images")
_NAME = re.compile(r"(.+)_(\d{1,3})")


def is_one(folder: Path) -> bool:
    """Return whether a folder is in one of the three forms."""
    return _is_rendered(folder) or (folder / ARRAY).is_file() or _is_handed_on(folder)


def read(folder: Path) -> Given:
    """The photographs of a scene, the exposures of a view as one frame.

    InputError if the folder is in none of the forms, or what is there contradicts itself.
    """
    if _is_rendered(folder):
        return _rendered(folder)
    if colmap.model_folder(folder) is not None and _images(folder) is not None:
        return _handed_on(folder)
    if (folder / ARRAY).is_file():
        return _photographed(folder)
    raise InputError(f"{folder} has neither exposure_train.json nor {ARRAY}: use --layout photos.")


def _is_rendered(folder: Path) -> bool:
    return all((folder / name).is_file() for name in ("transforms_train.json", "exposure_train.json"))


def _is_handed_on(folder: Path) -> bool:
    """Return whether names say that photographs are exposures of views, true light and a model of them.

    Any COLMAP project may have a folder `exr/`, and numbered frames have the names of exposures.
    """
    light, root = folder / "exr", _images(folder)
    place = colmap.model_folder(folder) if light.is_dir() else None
    if root is None or place is None:
        return False
    names = [_NAME.fullmatch(path.stem) if path.parent == root else None for path in pictures_in(root)]
    views = {name[1] for name in names if name is not None}
    if None in names or not any((light / f"{view}.exr").is_file() for view in views):
        return False
    named = [_NAME.fullmatch(Path(image.name).stem) for image in read_model(place).images.values()]
    posed = [name[1] for name in named if name is not None]
    return len(posed) == len(set(posed))


def _images(folder: Path) -> Path | None:
    return next((folder / name for name in _FOLDERS if (folder / name).is_dir()), None)


def _views(root: Path, other: LayoutName) -> dict[str, list[Path]]:
    """Exposures of every view in order of their index.

    InputError for a name without them, which advises the other layout that the folder may have.
    """
    views: dict[str, list[Path]] = {}
    for path in pictures_in(root):
        match = _NAME.fullmatch(path.stem)
        if path.parent != root or match is None:
            raise InputError(f"{shown(path)} is not named VIEW_INDEX: move it away or use --layout {other}.")
        views.setdefault(match[1], []).append(path)
    return views


def _rendered(folder: Path) -> Given:
    photos: list[GivenPhoto] = []
    truth: dict[int, Path] = {}
    missing: list[str] = []
    names: set[str] = set()
    frame = 0
    for split in ("train", "test"):
        source = folder / f"transforms_{split}.json"
        if not source.is_file():
            continue
        times = _times(folder / f"exposure_{split}.json")
        for number, entry in enumerate(entries(source)):
            if entry.file_path in names:
                raise InputError(
                    f"{entry.where} names {entry.file_path!r} a second time: take one of both out."
                )
            names.add(entry.file_path)
            exposed, lost = _exposures(folder, entry, times, frame, split == "test")
            photos += exposed
            missing += lost
            light = folder / f"{split}_hdr" / f"hdr_{number:03d}.exr"
            if light.is_file():
                truth[frame] = light
            frame += 1
    source = folder / "transforms_train.json"
    return Given("hdr-nerf", source, tuple(photos), truth=truth, missing=tuple(missing))


def _use(tested: bool, step: int) -> Literal["train", "test"] | None:
    """Return what the exposure of that index is for."""
    if tested:
        return "test"
    return "train" if step % 2 == 0 else None


def _tested(views: dict[str, list[Path]]) -> set[str]:
    """The views that are for testing where no file says so."""
    return set(sorted(views, key=lambda view: f"{view}_0")[1::2])


def _times(path: Path) -> dict[str, float]:
    """Seconds by the name of the file; InputError if the file does not say that."""
    value = store.read_json(path)
    if not isinstance(value, dict):
        raise InputError(f"{path} does not give a time for each photograph: export it again.")
    return {_plain(name): _seconds(time, f"{path}, {shown(name)}") for name, time in value.items()}


def _plain(name: str) -> str:
    return name.removeprefix("./")


def _seconds(value: Any, where: str) -> float:
    try:
        time = float(value)
    except (TypeError, ValueError, OverflowError):
        time = math.nan
    if not 0 < time < 1e6:
        raise InputError(f"{where} has an exposure of {str(value)[:40]} s: correct it.")
    return time


def _exposures(
    folder: Path, entry: PosedFrame, times: dict[str, float], frame: int, tested: bool
) -> tuple[list[GivenPhoto], list[str]]:
    """The photographs of one view, which are those that have a time; and those that are not there."""
    stem = _plain(entry.file_path)
    named = [name for name in times if re.fullmatch(rf"{re.escape(stem)}_\d{{1,3}}\.\w+", name)]
    if not named:
        raise InputError(f"{entry.where} has no exposure time: correct exposure_*.json.")
    paths = {name: store.inside(folder, name) for name in sorted(named, key=lambda name: (len(name), name))}
    there = {name: path for name, path in paths.items() if path.is_file()}
    missing = [
        f"{shown(path)} is named in {entry.where} but does not exist"
        for name, path in paths.items()
        if name not in there
    ]
    if not there:
        return [], missing
    lens, pose = entry.lens(next(iter(there.values()))), entry.cam_from_world()
    return [
        GivenPhoto(
            path, "0", lens, pose if lens else None, Exposure(time=times[name]), frame, _use(tested, step)
        )
        for step, (name, path) in enumerate(paths.items())
        if name in there
    ], missing


def _photographed(folder: Path) -> Given:
    source = folder / ARRAY
    root = _images(folder)
    if root is None:
        raise InputError(f"{folder} has no input_images/ beside {ARRAY}: copy it there.")
    views = _views(root, "photos")
    ordered = sorted((path for group in views.values() for path in group), key=lambda path: path.name)
    table = read_rows(source, COLUMNS)
    if len(table) != len(ordered):
        raise InputError(
            f"{source} has {len(table)} rows for {len(ordered)} photos in {root}: "
            "there has to be one for each."
        )
    row = dict(zip(ordered, range(len(table)), strict=True))
    lens = lens_of_rows(table, source)
    photos, tested = [], _tested(views)
    for frame, (view, group) in enumerate(views.items()):
        # One tripod, but every photograph got a pose of its own: the middle exposure shows most.
        middle = row[group[len(group) // 2]]
        pose = pose_of_row(table[middle, :15].reshape(3, 5), f"row {middle} of {source}")
        for step, path in enumerate(group):
            time = _seconds(table[row[path], -1], f"row {row[path]} of {source}")
            use = _use(view in tested, step)
            photos.append(GivenPhoto(path, "0", lens, pose, Exposure(time=time), frame, use))
    return Given("hdr-nerf", source, tuple(photos))


def _handed_on(folder: Path) -> Given:
    root, place = _images(folder), colmap.model_folder(folder)
    assert root is not None
    assert place is not None
    model = read_model(place)
    views = _views(root, "colmap")
    posed: dict[str, tuple[str, Lens | None, Pose | None]] = {}
    for image in model.images.values():
        match = _NAME.fullmatch(Path(image.name).stem)
        if match is None or match[1] not in views:
            raise InputError(
                f"{place} names {shown(image.name)}, which is not a photo in {root}: copy it there or use "
                "--layout colmap."
            )
        lens = colmap.lens_of_camera(model.cameras[image.camera_id], place)
        pose = colmap.pose_of_image(image, place) if lens is not None and image.has_pose else None
        posed.setdefault(match[1], (str(image.camera_id), lens, pose))
    times, note = _times_of(folder, root, views)
    photos, truth, tested = [], {}, _tested(views)
    any_camera = next(iter(posed.values()), ("0", None, None))
    for frame, (view, group) in enumerate(views.items()):
        camera, lens, pose = posed.get(view, (any_camera[0], any_camera[1], None))
        for step, path in enumerate(group):
            time = times.get(path)
            exposure = None if time is None else Exposure(time=time)
            use = _use(view in tested, step)
            photos.append(GivenPhoto(path, camera, lens, pose, exposure, frame, use))
        light = folder / "exr" / f"{view}.exr"
        if light.is_file() and kind_of(light) == "hdr":
            truth[frame] = light
    return Given("hdr-nerf", place, tuple(photos), model=place, images=root, truth=truth, notes=(note,))


def _times_of(folder: Path, root: Path, views: dict[str, list[Path]]) -> tuple[dict[Path, float], str]:
    """Seconds of each photograph, and where they are from."""
    ordered = sorted((path for group in views.values() for path in group), key=lambda path: path.name)
    source = folder / ARRAY
    if source.is_file():
        table = read_rows(source, COLUMNS)
        if len(table) != len(ordered):
            raise InputError(
                f"{source} has {len(table)} rows for {len(ordered)} photos in {root}: "
                "there has to be one for each; correct it or use --layout colmap."
            )
        times = {path: _seconds(table[n, -1], f"row {n} of {source}") for n, path in enumerate(ordered)}
        return times, f"The exposures are those of {ARRAY}."
    if all(len(group) == len(RENDERED_TIMES) for group in views.values()):
        times = {
            path: time for group in views.values() for path, time in zip(group, RENDERED_TIMES, strict=True)
        }
        listed = ", ".join(f"{time:g}" for time in RENDERED_TIMES)
        return (
            times,
            f"The exposures are taken to be {listed} s, as in HDR-GS; --exposures FILE states others.",
        )
    return {}, "No file states the exposures; --exposures FILE does."

"""nerfstudio's `transforms.json`, and the `transforms_train.json` of Blender scenes that it grew from.

A frame names a photograph and a camera-to-world matrix with OpenGL's camera axes (x right, y up, z
back); the lens stands in the frame or at the top, in pixels with the first centre at +0.5, as COLMAP
writes it: https://docs.nerf.studio/quickstart/data_conventions.html.
"""

from pathlib import Path
from typing import Any, Literal

import numpy as np

from capture.imports.layouts.given import FARTHEST, Given, GivenDepth, GivenPhoto
from capture.imports.layouts.named_files import file_named
from capture.imports.layouts.ply_points import read_ply_points
from capture.imports.layouts.posed_frame import PosedFrame
from capture.imports.layouts.split_lists import PARTS, photos_named, split
from capture.imports.layouts.transforms_notes import applied_scale, notes_of, rays_beside
from capture.imports.originals import shown
from imaging.and_list import and_list
from imaging.arrays import Array
from imaging.errors import InputError
from imaging.files import store
from imaging.natural_order import natural
from imaging.optics.lens import Lens

FILES = ("transforms.json", "transforms_train.json", "transforms_val.json", "transforms_test.json")

MOST_POINTS = 100_000
"""Scene points that are kept, evenly over their file."""


def is_one(folder: Path) -> bool:
    """Return whether a folder holds one of the files."""
    return any((folder / name).is_file() for name in FILES)


def entries(path: Path) -> list[PosedFrame]:
    """The frames of a file; InputError if it is not JSON with a list of them."""
    value = store.read_json(path)
    frames = value.get("frames") if isinstance(value, dict) else None
    tests = value.get("test_frames", []) if isinstance(value, dict) else []
    for listed in (frames, tests):
        if not isinstance(listed, list) or not all(isinstance(frame, dict) for frame in listed):
            raise InputError(f"{path} has no list of frames: use --layout photos, or export it again.")
    assert frames is not None
    use: Literal["train"] | None = "train" if tests else None
    train = [PosedFrame(frame, value, f"frame {n} of {path}", use) for n, frame in enumerate(frames)]
    return train + [
        PosedFrame(frame, value, f"test frame {n} of {path}", "test") for n, frame in enumerate(tests)
    ]


def files_in(folder: Path) -> list[Path]:
    """The files of the layout that a folder has: `transforms.json`, else those of its splits."""
    there = [folder / name for name in FILES if (folder / name).is_file()]
    if not there:
        raise InputError(f"{folder} has no transforms.json: use --layout photos.")
    return there[:1] if there[0].name == FILES[0] else there


def read(folder: Path) -> Given:
    """The photographs that the frames name, in natural order; others in the folder are not imported.

    A photograph that is named and does not exist is listed as missing. InputError for a frame that cannot be
    read, one that leads out of the folder, and two that name one photograph.
    """
    sources = files_in(folder)
    top = store.read_json(sources[0])
    lenses: dict[Lens | None, str] = {}
    photos: dict[Path, GivenPhoto] = {}
    framed: list[tuple[PosedFrame, GivenPhoto]] = []
    missing = []
    for entry, use in (
        (entry, entry.use or _use(source, sources)) for source in sources for entry in entries(source)
    ):
        path = file_named(folder, entry.file_path)
        if path in photos:
            raise InputError(f"{entry.where} names {shown(path)} a second time: take one of both out.")
        if not path.is_file():
            missing.append(f"{shown(path)} is named in {entry.where} but does not exist")
            continue
        lens = None if rays_beside(path, entry) else entry.lens(path)
        camera = lenses.setdefault(lens, str(len(lenses)))
        pose = entry.cam_from_world()
        photos[path] = GivenPhoto(
            path, camera, lens, pose if lens else None, entry.exposure(), use=use, mask=_mask(folder, entry),
            depth=_depth(folder, entry),
        )  # fmt: skip
        framed.append((entry, photos[path]))
    given = Given(
        "nerfstudio",
        sources[0],
        tuple(sorted(photos.values(), key=lambda photo: natural(photo.path))),
        points=_scene_points(folder, top, sources[0]),
        missing=tuple(missing),
        notes=tuple(notes_of(framed, top)),
    )
    lists = {part: top[f"{part}_filenames"] for part in PARTS if top.get(f"{part}_filenames")}
    if lists and len(sources) == 1:
        named = {part: photos_named(given, folder, names) for part, names in lists.items()}
        given = split(given, named, and_list(f"{part}_filenames" for part in lists))
    return given


def _use(source: Path, sources: list[Path]) -> Literal["train", "test"] | None:
    """Use of the photographs of one of the files; validation counts as neither where there is a test set."""
    part = source.stem.removeprefix("transforms").removeprefix("_")
    if part == "val":
        return "test" if all(other.name != "transforms_test.json" for other in sources) else None
    return {"train": "train", "test": "test"}.get(part)  # type: ignore[return-value]


def _scene_points(folder: Path, top: dict[str, Any], source: Path) -> Array | None:
    """The points in the PLY file that `ply_file_path` names, in the world of the poses.

    nerfstudio takes poses for `applied_scale` times what points and depth maps are.
    """
    name = top.get("ply_file_path")
    if name is None:
        return None
    if not isinstance(name, str):
        raise InputError(f"{source} has a ply_file_path that is not a file name: correct or remove it.")
    points = read_ply_points(file_named(folder, name))
    points = points[np.isfinite(points).all(axis=1)] * applied_scale(PosedFrame({}, top, str(source)))
    # Laser scanners write millions; training starts from some ten thousand.
    return points[:: 1 + len(points) // MOST_POINTS]


def _mask(folder: Path, entry: PosedFrame) -> Path | None:
    """The file that a `mask_path` means; InputError if it is not there."""
    return _file(folder, entry, "mask_path")


def _depth(folder: Path, entry: PosedFrame) -> GivenDepth | None:
    """The depth map that a `depth_file_path` means, or Instant NGP's `depth_path`; InputError as `_mask`.

    The unit of whole numbers is `integer_depth_scale` or `depth_unit_scale_factor`, where the file says it.
    None where the file says that depth maps are not to be read, or that they are in another unit than poses.
    """
    if entry.top.get("enable_depth_loading") is False or applied_scale(entry) != 1:
        return None
    path = _file(folder, entry, "depth_file_path") or _file(folder, entry, "depth_path")
    if path is None:
        return None
    for key in ("integer_depth_scale", "depth_unit_scale_factor"):
        unit = entry.number(key)
        if unit is not None and not 0 < unit < FARTHEST:
            raise InputError(f"{entry.where} has a {key} of {unit:g}: correct it or take it out.")
        if unit is not None:
            return GivenDepth(path, unit)
    return GivenDepth(path)


def _file(folder: Path, entry: PosedFrame, key: str) -> Path | None:
    """File that a frame names, or None. InputError if it does not exist."""
    name = entry.values.get(key)
    if name is None:
        return None
    path = file_named(folder, name) if isinstance(name, str) and name else None
    if path is None or not path.is_file():
        raise InputError(f"{entry.where} has a {key} {name!r} that is not a file: correct or remove it.")
    return path

"""RawNeRF's layout (Mildenhall et al., CVPR 2022), as the loader of multinerf reads it.

`raw/` holds a DNG for each photograph, and beside it what `exiftool -json` says of it; lenses and poses are
those of the developed copies in `images/`, which have the same names but for the suffix: a COLMAP model in
`sparse/0`, or rows of `poses_bounds.npy`. Every eighth photograph, by name, is for testing.

Test scenes have `hdrplus_test/merged.dng`, a burst merged to one clean mosaic. In them the first name is that
of a copy of the test image: its pose is that of the shots in `raw/test/`, the first of which is exposed as
those in `raw/train/`, which all other names are of.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from capture.imports.layouts import colmap, llff
from capture.imports.layouts.colmap_files import read_model
from capture.imports.layouts.given import Given, GivenPhoto
from capture.imports.originals import shown
from imaging.errors import InputError
from imaging.files import store
from imaging.optics.exposure import Exposure
from imaging.optics.lens import Lens
from imaging.optics.pose import Pose

MERGED = Path("hdrplus_test", "merged.dng")
"""The clean mosaic of a test scene; its codes have two bits more than those of the shots."""
EVERY = 8
"""Stride of the test photographs, in data sets without a clean mosaic."""


@dataclass(frozen=True)
class _Image:
    """A developed image: its name without suffix, and what is known of it."""

    stem: str
    camera: str
    lens: Lens | None
    pose: Pose | None
    name: str


def is_one(folder: Path) -> bool:
    """Return whether a folder has poses, and DNG files with a sidecar or with a clean mosaic."""
    if colmap.model_folder(folder) is None and not llff.is_one(folder):
        return False
    if (folder / MERGED).is_file():
        return (folder / "raw" / "train").is_dir()
    return any(raw.with_suffix(".json").is_file() for raw in _raws(folder / "raw").values())


def read(folder: Path) -> Given:
    """The mosaics of a scene, each a frame of its own, with the test shots of a test scene as one frame.

    InputError if the folder has no such files, or a sidecar or a pose is damaged.
    """
    source, images = _images(folder)
    if (folder / MERGED).is_file():
        return _test_scene(folder, source, images)
    raws = _raws(folder / "raw")
    if not raws:
        raise InputError(f"{folder / 'raw'} holds no DNG file: copy them there, or use --layout photos.")
    uses: list[Literal["train", "test"]] = ["test" if n % EVERY == 0 else "train" for n in range(len(images))]
    photos, missing = _photos(images, raws, folder / "raw", 0, uses)
    return _given(folder, source, images, photos, missing, _unposed(raws, images, source))


def _test_scene(folder: Path, source: Path, images: Sequence[_Image]) -> Given:
    tests, raws = _raws(folder / "raw" / "test"), _raws(folder / "raw" / "train")
    if not tests:
        raise InputError(f"{folder / 'raw' / 'test'} has no DNG file beside {MERGED}: copy them there.")
    if not images:
        raise InputError(f"{source} has no image with a pose: export it again.")
    first, *rest = images
    photos = [
        GivenPhoto(path, first.camera, first.lens, first.pose, _exposure(path), 0, None if number else "test")
        for number, (_, path) in enumerate(sorted(tests.items()))
    ]
    trained, missing = _photos(rest, raws, folder / "raw" / "train", 1, ["train"] * len(rest))
    notes = [
        f"{shown(first.name)} is the test view; its clean mosaic, {MERGED}, is read by `rig bench rawnerf`.",
        *_unposed(raws, rest, source),
    ]
    return _given(folder, source, images, [*photos, *trained], missing, notes)


def _given(
    folder: Path,
    source: Path,
    images: Sequence[_Image],
    photos: Sequence[GivenPhoto],
    missing: Sequence[str],
    notes: Sequence[str],
) -> Given:
    has_model = source.is_dir()
    first_of = {photo.frame: photo.path for photo in reversed(photos)}
    return Given(
        "rawnerf",
        source,
        tuple(photos),
        model=source if has_model else None,
        images=folder / "images" if has_model else None,
        developed={image.name: first_of[n] for n, image in enumerate(images) if n in first_of},
        missing=tuple(missing),
        notes=tuple(notes),
    )


def _images(folder: Path) -> tuple[Path, list[_Image]]:
    """Return the source of the poses, and the images that have one, by name as text."""
    place = colmap.model_folder(folder)
    if place is None:
        paths, poses, lens = llff.posed_images(folder)
        images = [
            _Image(path.stem, "0", lens, pose, path.name) for path, pose in zip(paths, poses, strict=True)
        ]
        source = folder / llff.ARRAY
    else:
        source, images = place, []
        model = read_model(place)
        lenses = {key: colmap.lens_of_camera(camera, place) for key, camera in model.cameras.items()}
        for image in sorted(model.images.values(), key=lambda image: str(image.name)):
            if not image.has_pose:
                continue
            lens_of_camera = lenses[image.camera_id]
            pose = None if lens_of_camera is None else colmap.pose_of_image(image, place)
            images.append(
                _Image(Path(image.name).stem, str(image.camera_id), lens_of_camera, pose, image.name)
            )
    stems = [image.stem for image in images]
    twice = next((stem for stem in stems if stems.count(stem) > 1), None)
    if twice is not None:
        raise InputError(f"{source} has two images named {shown(twice)}: take one of both out.")
    return source, images


def _raws(folder: Path) -> dict[str, Path]:
    """The DNG files of a folder by their names without suffix."""
    if not folder.is_dir():
        return {}
    return {path.stem: path for path in sorted(folder.iterdir()) if path.suffix.lower() == ".dng"}


def _photos(
    images: Sequence[_Image],
    raws: dict[str, Path],
    root: Path,
    first: int,
    uses: Sequence[Literal["train", "test"]],
) -> tuple[list[GivenPhoto], list[str]]:
    """The mosaics of images, frames counted from `first`; and a sentence for each that is not there."""
    photos, missing = [], []
    for number, (image, use) in enumerate(zip(images, uses, strict=True), start=first):
        path = raws.get(image.stem)
        if path is None:
            missing.append(
                f"{shown(root / image.stem)}.dng, of which {shown(image.name)} is made, does not exist"
            )
            continue
        photos.append(GivenPhoto(path, image.camera, image.lens, image.pose, _exposure(path), number, use))
    return photos, missing


def _unposed(raws: dict[str, Path], images: Sequence[_Image], source: Path) -> list[str]:
    count = len(raws.keys() - {image.stem for image in images})
    files = "1 DNG file is" if count == 1 else f"{count} DNG files are"
    return [f"{files} left aside, since {source} has no pose for them."] if count else []


def _exposure(raw: Path) -> Exposure | None:
    """Exposure in a sidecar; None without one: that of the file counts.

    InputError if the sidecar is damaged or has an impossible time, ISO or f-number.
    """
    path = raw.with_suffix(".json")
    if not path.is_file():
        return None
    value = store.read_json(path)
    if not isinstance(value, list) or not value or not isinstance(value[0], dict):
        raise InputError(f"{path} is not what exiftool -json writes: write it again, or take it out.")
    tags = value[0]
    time = _number(tags, path, "ShutterSpeed") or _number(tags, path, "ExposureTime")
    if time is None:
        return None
    return Exposure(time=time, f_number=_number(tags, path, "FNumber"), iso=_number(tags, path, "ISO"))


def _number(tags: dict[str, Any], path: Path, key: str) -> float | None:
    """A positive number, which exiftool may write as `1/45`; None if the key is not there."""
    value = tags.get(key)
    if value is None:
        return None
    try:
        over, _, under = str(value).partition("/")
        number = float(over) / float(under or 1)
    except (ValueError, ZeroDivisionError):
        number = math.nan
    if not 0 < number < 1e6 or isinstance(value, bool):
        raise InputError(f"{path} has a {key} of {shown(str(value)[:40])}: correct it, or take the file out.")
    return number

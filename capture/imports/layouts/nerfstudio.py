"""nerfstudio's `transforms.json`, and the `transforms_train.json` of Blender scenes that it grew from.

A frame names a photograph and a camera-to-world matrix with OpenGL's camera axes (x right, y up, z
back); the lens stands in the frame or at the top, in pixels with the first centre at +0.5, as COLMAP
writes it: https://docs.nerf.studio/quickstart/data_conventions.html.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from capture.imports.layouts.given import (
    FARTHEST,
    OPENCV_FROM_OPENGL,
    Given,
    GivenDepth,
    GivenPhoto,
    lens_of,
    pose_seen,
)
from capture.imports.layouts.named_files import file_named
from capture.imports.layouts.nearest_lens import nearest_lens
from capture.imports.layouts.ply_points import read_ply_points
from capture.imports.layouts.split_lists import PARTS, photos_named, split
from capture.imports.originals import shown
from capture.pictures.read import read_picture
from imaging.arrays import Array
from imaging.errors import InputError
from imaging.exposure import Exposure
from imaging.files import store
from imaging.lens import Lens, distort
from imaging.natural_order import natural
from imaging.pose import Pose

FILES = ("transforms.json", "transforms_train.json", "transforms_val.json", "transforms_test.json")

KNOWN_MODELS = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL")
"""Camera models whose distortion is that of k1, k2, p1 and p2, or none."""
FISHEYE = "OPENCV_FISHEYE"
"""The camera model whose distortion is that of k1, k2, k3 and k4, of the angle from the axis."""

MOST_POINTS = 100_000
"""Scene points that are kept, evenly over their file."""


_NEAREST: dict[tuple[object, ...], Lens | None] = {}
"""Lenses that were sought already, since all frames of a file mostly have one."""


@dataclass(frozen=True)
class PosedFrame:
    """One element of `frames`, with the top of its file, and words to name it by."""

    values: dict[str, Any]
    top: dict[str, Any]
    where: str
    use: Literal["train", "test"] | None = None
    """Its use by `test_frames`, as ScanNet++ has them beside `frames`; None without them."""

    def number(self, key: str) -> float | None:
        """Number of the frame, else of the top; None if neither has it; InputError if it is not a number."""
        value = self.values.get(key, self.top.get(key))
        if value is None:
            return None
        if isinstance(value, bool) or not isinstance(value, int | float) or not _is_finite(value):
            raise InputError(f"{self.where} has a {key} that is no finite number: correct it.")
        return float(value)

    @property
    def file_path(self) -> str:
        """The `file_path`; InputError if it is empty."""
        path = self.values.get("file_path")
        if not isinstance(path, str) or not path:
            raise InputError(f"{self.where} has no file_path: correct it or take the frame out.")
        return path

    def cam_from_world(self) -> Pose:
        """`transform_matrix` as a pose; InputError if it is no rigid motion."""
        try:
            matrix = np.array(self.values.get("transform_matrix"), np.float64)
        except (ValueError, TypeError, OverflowError):
            matrix = np.zeros(0)
        if matrix.shape == (3, 4):
            matrix = np.vstack([matrix, [0.0, 0.0, 0.0, 1.0]])
        if matrix.shape != (4, 4):
            raise InputError(f"{self.where} has no transform_matrix of 4x4 numbers: correct it.")
        return pose_seen(matrix @ OPENCV_FROM_OPENGL, self.where)

    def _camera_model(self) -> Any:
        """`camera_model`, or what `is_fisheye` says in its place, as Instant NGP writes it."""
        model, fisheye = (self.values.get(key, self.top.get(key)) for key in ("camera_model", "is_fisheye"))
        if fisheye not in (None, True, False) or (fisheye and model not in (None, FISHEYE)):
            raise InputError(
                f"{self.where} has is_fisheye {fisheye!r:.40} and camera_model {model!r:.40}: take one out."
            )
        return FISHEYE if fisheye else "OPENCV" if model is None else model

    def lens(self, photo: Path) -> Lens | None:
        """Lens of the frame; None if rig has no such model. `photo` gives the size if no key does."""
        model = self._camera_model()
        fisheye = model == FISHEYE
        names = ("k1", "k2", "k3", "k4") if fisheye else ("k1", "k2", "p1", "p2")
        others = [key for key in ("p1", "p2", "k3", "k4", "k5", "k6") if key not in names]
        unlike = [key for key in others if self.number(key)]
        further = not fisheye and set(unlike) <= {"k3", "k4"}
        if (not fisheye and model not in KNOWN_MODELS) or (unlike and not further):
            return None
        width, height = self.number("w"), self.number("h")
        if width is None or height is None:
            picture = read_picture(photo)
            width, height = picture.width, picture.height
        if not (0 < width < 1e6 and 0 < height < 1e6):
            raise InputError(f"{self.where} has a size of {width:g}x{height:g} pixels: correct w and h.")
        fx, fy = self.number("fl_x"), self.number("fl_y")
        if not fisheye:  # of which the angle says nothing without its terms
            fx = fx or _focal(self.number("camera_angle_x"), width)
            fy = fy or _focal(self.number("camera_angle_y"), height)
        fx, fy = fx or fy, fy or fx
        if fx is None or fy is None:
            keys = "fl_x" if fisheye else "fl_x or camera_angle_x"
            raise InputError(f"{self.where} has no focal length: write {keys}.")
        centre = {
            key: half if value is None else value
            for key, value, half in (
                ("cx", self.number("cx"), width / 2),
                ("cy", self.number("cy"), height / 2),
            )
        }
        terms = {key: self.number(key) or 0.0 for key in names}
        if unlike:
            return self._nearest((int(width), int(height)), (fx, fy, centre["cx"], centre["cy"]), terms)
        return lens_of(
            "OPENCV_FISHEYE" if fisheye else "OPENCV" if any(terms.values()) else "PINHOLE",
            (int(width), int(height)),
            {"fx": fx, "fy": fy, **centre, **terms},
            self.where,
        )

    def _nearest(
        self, size: tuple[int, int], centred: tuple[float, float, float, float], terms: dict[str, float]
    ) -> Lens | None:
        """The lens of `rig` nearest to one with the radial terms k3 and k4 as well."""
        k3, k4 = self.number("k3") or 0.0, self.number("k4") or 0.0
        focal, middle = np.array(centred[:2]), np.array(centred[2:])

        def image_of(tangents: Array) -> Array:
            square = (tangents**2).sum(-1, keepdims=True)
            bent = distort(tangents, list(terms.values()), fisheye=False)
            return np.asarray((bent + tangents * square**3 * (k3 + square * k4)) * focal + middle)

        key = (size, centred, *terms.values(), k3, k4)
        if key not in _NEAREST:
            _NEAREST[key] = nearest_lens(image_of, size, centred, self.where)[0]
        return _NEAREST[key]

    def exposure(self) -> Exposure | None:
        """Return what `exposure_time`, in seconds, says; no other key has an agreed meaning."""
        time = self.number("exposure_time")
        if time is not None and not 0 < time < 1e6:
            raise InputError(f"{self.where} has an exposure_time of {time:g} s: correct it.")
        return None if time is None else Exposure(time=time)


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
    missing = []
    for entry, use in (
        (entry, entry.use or _use(source, sources)) for source in sources for entry in entries(source)
    ):
        path = file_named(folder, entry.file_path)
        if path in photos:
            raise InputError(f"{entry.where} names {shown(path)} a second time: take one of both out.")
        if not path.is_file():
            missing.append(f"{shown(path)} is named in {entry.where} but is not there")
            continue
        lens = entry.lens(path)
        camera = lenses.setdefault(lens, str(len(lenses)))
        pose = entry.cam_from_world()
        photos[path] = GivenPhoto(
            path, camera, lens, pose if lens else None, entry.exposure(), use=use, mask=_mask(folder, entry),
            depth=_depth(folder, entry),
        )  # fmt: skip
    given = Given(
        "nerfstudio",
        sources[0],
        tuple(sorted(photos.values(), key=lambda photo: natural(photo.path))),
        points=_scene_points(folder, sources[0]),
        missing=tuple(missing),
        notes=tuple(_notes(photos.values(), lenses, top)),
    )
    lists = {part: top[f"{part}_filenames"] for part in PARTS if top.get(f"{part}_filenames")}
    if lists and len(sources) == 1:
        named = {part: photos_named(given, folder, names) for part, names in lists.items()}
        given = split(given, named, " and ".join(f"{part}_filenames" for part in lists))
    return given


def _use(source: Path, sources: list[Path]) -> Literal["train", "test"] | None:
    """Use of the photographs of one of the files; validation counts as neither where there is a test set."""
    part = source.stem.removeprefix("transforms").removeprefix("_")
    if part == "val":
        return "test" if all(other.name != "transforms_test.json" for other in sources) else None
    return {"train": "train", "test": "test"}.get(part)  # type: ignore[return-value]


def _notes(
    photos: Iterable[GivenPhoto], lenses: dict[Lens | None, str], top: dict[str, Any]
) -> Iterable[str]:
    if any(lens is not None and not lens.fisheye for lens in lenses) and (top.get("k3") or top.get("k4")):
        yield (
            "The radial terms k3 and k4 are folded into the others, which differs by less than a pixel "
            "anywhere."
        )
    if None in lenses:
        count = sum(photo.lens is None for photo in photos)
        yield (
            f"{count} photos come without lens and pose, since no lens of rig is like that of their "
            "camera_model: undistort the images first if the poses matter."
        )


def _scene_points(folder: Path, source: Path) -> Array | None:
    """The points in the PLY file that `ply_file_path` names, in the world of the poses."""
    name = store.read_json(source).get("ply_file_path")
    if name is None:
        return None
    if not isinstance(name, str):
        raise InputError(f"{source} has a ply_file_path that is no name: correct it or take it out.")
    points = read_ply_points(file_named(folder, name))
    points = points[np.isfinite(points).all(axis=1)]
    # Laser scanners write millions; training starts from some ten thousand.
    return points[:: 1 + len(points) // MOST_POINTS]


def _mask(folder: Path, entry: PosedFrame) -> Path | None:
    """The file that a `mask_path` means; InputError if it is not there."""
    return _file(folder, entry, "mask_path")


def _depth(folder: Path, entry: PosedFrame) -> GivenDepth | None:
    """The depth map that a `depth_file_path` means, or Instant NGP's `depth_path`; InputError as `_mask`.

    The unit of whole numbers is `integer_depth_scale`, where the file says it.
    """
    path = _file(folder, entry, "depth_file_path") or _file(folder, entry, "depth_path")
    if path is None:
        return None
    unit = entry.number("integer_depth_scale")
    if unit is not None and not 0 < unit < FARTHEST:
        raise InputError(f"{entry.where} has an integer_depth_scale of {unit:g}: correct it or take it out.")
    return GivenDepth(path, unit)


def _file(folder: Path, entry: PosedFrame, key: str) -> Path | None:
    """File that a frame names, or None. InputError if it does not exist."""
    name = entry.values.get(key)
    if name is None:
        return None
    path = file_named(folder, name) if isinstance(name, str) and name else None
    if path is None or not path.is_file():
        raise InputError(f"{entry.where} has a {key} {name!r} that is no file: correct it or take it out.")
    return path


def _focal(angle: float | None, pixels: float) -> float | None:
    """Focal length, px, for a field of view in radians across that many pixels."""
    return pixels / 2 / math.tan(angle / 2) if angle is not None and 0 < angle < math.pi else None


def _is_finite(value: int | float) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number beyond floats
        return False

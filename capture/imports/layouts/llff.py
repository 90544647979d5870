"""LLFF's layout (Mildenhall et al., SIGGRAPH 2019): `images/`, and a row of `poses_bounds.npy` for each.

A row [17] is a 3x5 matrix (columns down, right, back, centre, and height, width, focal length) and two
depths; [14] beside `hwf_cxcy.npy` (height, width, fx, fy, cx, cy), as NeX has it. The scenes of HDR-Plenoxels
(Jun-Seong et al., ECCV 2022) come in it. Rows are in the order of the names of the images, as text; where all
names begin with the number of a split, as `0_` and `1_`, that number does not count.
"""

from pathlib import Path

import numpy as np

from capture.imports.layouts.given import OPENCV_FROM_OPENGL, Given, GivenPhoto, lens_of, pose_seen
from capture.imports.originals import pictures_in
from imaging.arrays import Array
from imaging.compute.memory import check
from imaging.errors import InputError
from imaging.optics.lens import Lens
from imaging.optics.pose import Pose

ARRAY = "poses_bounds.npy"
INTRINSICS = "hwf_cxcy.npy"


def is_one(folder: Path) -> bool:
    """Return whether a folder has images and rows of poses."""
    return (folder / ARRAY).is_file() and (folder / "images").is_dir()


def read(folder: Path) -> Given:
    """The images of a scene, each a frame of its own; InputError if the rows do not fit them."""
    source = folder / ARRAY
    images, poses, lens = posed_images(folder)
    notes = []
    if [path.name for path in images] != sorted(path.name for path in images):
        notes.append(f"The rows of {ARRAY} are taken in the order of names without the number of the split.")
    photos = tuple(
        GivenPhoto(path, "0", lens, pose, frame=frame)
        for frame, (path, pose) in enumerate(zip(images, poses, strict=True))
    )
    return Given("llff", source, photos, notes=tuple(notes))


def posed_images(folder: Path) -> tuple[list[Path], list[Pose], Lens]:
    """The images of a folder in the order of the rows, their poses, and the lens that they share.

    InputError if there is not one row for each image, or what a row says cannot be.
    """
    source, root = folder / ARRAY, folder / "images"
    images = sorted((path for path in pictures_in(root) if path.parent == root), key=lambda path: path.name)
    if images and all(path.name[0].isdecimal() and path.name[1] == "_" for path in images):
        images.sort(key=lambda path: path.name[2:])
    if (folder / INTRINSICS).is_file():
        rows = read_rows(source, 14)
        table = read_rows(folder / INTRINSICS, 6)
        height, width, fx, fy, cx, cy = table[0].tolist()
        lens = _lens(width, height, {"fx": fx, "fy": fy, "cx": cx, "cy": cy}, folder / INTRINSICS)
        poses = [pose_of_row(row[:12].reshape(3, 4), f"row {n} of {source}") for n, row in enumerate(rows)]
    else:
        rows = read_rows(source, 17)
        lens = lens_of_rows(rows, source)
        poses = [pose_of_row(row[:15].reshape(3, 5), f"row {n} of {source}") for n, row in enumerate(rows)]
    if len(poses) != len(images):
        raise InputError(
            f"{source} has {len(poses)} rows for {len(images)} photos in {root}: there must be one for each."
        )
    return images, poses, lens


def read_rows(path: Path, columns: int) -> Array:
    """Numbers of an .npy, float64 [rows, columns], a single row maybe alone; InputError for any others."""
    try:
        # mapped, so that a shape that the file does not hold takes no memory
        stored = np.load(path, mmap_mode="r", allow_pickle=False)
        if not isinstance(stored, np.ndarray) or stored.dtype.kind not in "fiu":
            raise TypeError
        check(f"{path} has {stored.size} numbers", 8 * stored.size)
        table = np.atleast_2d(stored.astype(np.float64))
    except (OSError, ValueError, TypeError, EOFError, MemoryError, SyntaxError) as error:
        raise InputError(f"{path} cannot be read as an array of numbers: export it again.") from error
    if table.ndim != 2 or table.shape[1] != columns or not len(table):
        raise InputError(
            f"{path} has the shape {list(stored.shape)}, not [photos, {columns}]: export it again."
        )
    return table


def pose_of_row(matrix: Array, where: str) -> Pose:
    """The pose in a matrix [3, 4 or 5] of a row, whose camera axes are x down, y right, z back."""
    world_from_cam = np.eye(4)
    world_from_cam[:3] = np.stack([matrix[:, 1], -matrix[:, 0], matrix[:, 2], matrix[:, 3]], axis=1)
    return pose_seen(world_from_cam @ OPENCV_FROM_OPENGL, where)


def lens_of_rows(table: Array, source: Path) -> Lens:
    """The lens that rows [N, 15 or more] share: centred, without distortion."""
    stated = table[:, [4, 9, 14]]
    if not np.isfinite(stated).all() or np.ptp(stated, axis=0).max() > 1e-3:
        raise InputError(f"{source} has photos of more than one size or focal length: use --layout photos.")
    height, width, focal = stated[0].tolist()
    return _lens(width, height, {"fx": focal, "fy": focal, "cx": width / 2, "cy": height / 2}, source)


def _lens(width: float, height: float, terms: dict[str, float], source: Path) -> Lens:
    if not (0.5 < height < 1e6 and 0.5 < width < 1e6):
        raise InputError(f"{source} has photos of {width:g}x{height:g} pixels: export it again.")
    return lens_of("PINHOLE", (round(width), round(height)), terms, f"{source}")

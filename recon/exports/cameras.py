"""The cameras of a scene's views for other programs: a COLMAP model as text, and `transforms.json`.

Lenses with their distortion, poses in the coordinates of the other exports; images are called as the session
calls the first photograph of each view.
"""

import json
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from imaging.errors import InputError
from imaging.files import store
from imaging.files.nerfstudio import Picture, transforms
from recon.exports.job import Job, Written
from recon.exports.place import Place
from recon.result.scene import Scene

COLMAP, NERFSTUDIO = "colmap", "transforms.json"


def write(job: Job) -> Written:
    """As `rig export` does."""
    if job.out.is_file():
        raise InputError(f"{job.out} is a file, and cameras fill a folder: name another --out.")
    return Written(write_cameras(job.out, job.scene, job.place))


def write_cameras(folder: Path, scene: Scene, place: Place) -> list[Path]:
    """FOLDER/colmap and FOLDER/transforms.json; the files written. InputError of a scene without views."""
    pictures = [
        Picture(view.shots[0].file if view.shots else f"{view.camera}.{view.frame:04d}.exr", view.lens,
                _moved(view.cam_from_world.matrix(), scene))
        for view in scene.views
    ]  # fmt: skip
    if not pictures:
        raise InputError(f"{scene.folder} has no views whose cameras could be written.")
    coordinates = {
        "unit": "m" if place.metres else "relative",
        "system": place.note,
        "offset": list(scene.record.offset),
    }
    cameras, images = [], []
    for number, picture in enumerate(pictures, 1):
        lens, motion = picture.lens, picture.cam_from_world
        terms = " ".join(repr(term) for term in lens.terms)
        model = "OPENCV_FISHEYE" if lens.fisheye else "OPENCV"
        cameras.append(f"{number} {model} {lens.width} {lens.height} {terms}")
        wxyz = Rotation.from_matrix(motion[:3, :3]).as_quat(canonical=True, scalar_first=True)
        pose = " ".join(repr(float(part)) for part in (*wxyz, *motion[:3, 3]))
        images += [f"{number} {pose} {number} {picture.path}", ""]
    texts = {
        f"{COLMAP}/cameras.txt": "\n".join(cameras),
        f"{COLMAP}/images.txt": "\n".join(images),
        f"{COLMAP}/points3D.txt": "",
        NERFSTUDIO: json.dumps(transforms(pictures, coordinates), indent=1, allow_nan=False),
    }
    for name, text in texts.items():
        store.write_bytes(folder / name, f"{text}\n".encode())
    return [folder / name for name in texts]


def _moved(
    motion: "np.ndarray[tuple[int, ...], np.dtype[np.float64]]", scene: Scene
) -> "np.ndarray[tuple[int, ...], np.dtype[np.float64]]":
    """A pose [4, 4] in coordinates less the scene's offset."""
    moved = motion.copy()
    moved[:3, 3] += motion[:3, :3] @ np.asarray(scene.record.offset)
    return moved

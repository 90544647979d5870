"""The training views of a session as a nerfstudio folder: what every other trainer is given."""

from pathlib import Path

import numpy as np

from capture.imports.layouts.given import OPENCV_FROM_OPENGL
from imaging.arrays import Array
from imaging.files import store
from imaging.files.photo import encode_png
from recon.data.dataset import Dataset, View


def write_peer_folder(
    dataset: Dataset,
    points: Array,
    colours: Array,
    folder: Path,
    background: tuple[float, float, float],
) -> None:
    """The photographs that rig trains on, pixel by pixel, their lenses and poses, and scene points.

    points [P, 3], in the world; colours [P, 3], display values 0..1. background: what the trainer draws
    behind its Gaussians; where a photograph is transparent it gets just that.
    """
    frames = []
    for number, view in enumerate(dataset.train):
        name = f"images/{number:04d}.png"
        shown = picture_of(view)
        if view.alpha is not None:
            shown = shown + (1 - view.alpha.astype(np.float64))[..., None] * background
        codes = np.rint(255 * shown).clip(0, 255).astype(np.uint8)
        store.write_bytes(folder / name, encode_png(codes))
        camera = dataset.world.camera_in_world(view.lens)
        if camera.fisheye:
            raise ValueError("OpenSplat knows no fisheye: undistort the photographs first")
        frames.append(
            {
                "file_path": name,
                "transform_matrix": (np.linalg.inv(camera.cam_from_world) @ OPENCV_FROM_OPENGL).tolist(),
                "w": camera.width,
                "h": camera.height,
                "fl_x": camera.fx,
                "fl_y": camera.fy,
                "cx": camera.cx,
                "cy": camera.cy,
                "k1": camera.k1,
                "k2": camera.k2,
                "p1": camera.p1,
                "p2": camera.p2,
            }
        )
    store.write_bytes(folder / "points.ply", _ply(points, colours))
    record = {"camera_model": "OPENCV", "ply_file_path": "points.ply", "frames": frames}
    store.write_json(folder / "transforms.json", record)


def picture_of(view: View) -> Array:
    """The one photograph of a view, display values [H, W, 3] in 0..1."""
    (shot,) = view.shots
    return shot.pixels.astype(np.float64)


def _ply(points: Array, colours: Array) -> bytes:
    kinds = [(axis, "<f4") for axis in "xyz"] + [(name, "u1") for name in ("red", "green", "blue")]
    table = np.empty(len(points), kinds)
    for place, axis in enumerate("xyz"):
        table[axis] = points[:, place]
    for place, name in enumerate(("red", "green", "blue")):
        table[name] = np.rint(255 * colours[:, place]).clip(0, 255)
    properties = [*(f"property float {axis}" for axis in "xyz")]
    properties += [f"property uchar {name}" for name in ("red", "green", "blue")]
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}", *properties]
    return ("\n".join([*head, "end_header", ""])).encode() + table.tobytes()

"""The painted wall in the layout of HDR-Pretrain: five exposures of each view, and the true light."""

import json
from pathlib import Path

import numpy as np

from imaging.colour.spaces import srgb_encode
from imaging.files.colmap import pycolmap
from imaging.files.exr.writing import write_exr
from imaging.files.photo import encode_png
from tests.rig.benchmarks.painted_wall import AWAY, CENTRES, FOCAL, HEIGHT, WIDTH, light, put

TIMES = (1.0, 2.0, 4.0, 8.0, 16.0)
TESTED = (1, 4, 7)


def hdr_pretrain_scene(folder: Path) -> Path:
    """Write a scene; its world is seen through the second exposure of each view."""
    model, times = pycolmap.Reconstruction(), {}
    camera = pycolmap.Camera.create_from_model_name(1, "PINHOLE", FOCAL, WIDTH, HEIGHT)
    camera.params = [FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2]
    model.add_camera_with_trivial_rig(camera)
    count = {"train": 0, "test": 0}
    for number, (x, y) in enumerate(CENTRES):
        part = "test" if number in TESTED else "train"
        stem = f"{part}_ldr_{count[part]:03d}"
        for step, time in enumerate(TIMES):
            codes = np.rint(255 * srgb_encode(light((x, y)) * time)).astype(np.uint8)
            put(folder / "images" / f"{stem}_{step}.png", encode_png(codes))
            times[f"{stem}_{step}.png"] = time
        truth = light((x, y)).astype(np.float32)
        write_exr(folder / "images_hdr" / f"{part}_hdr_{count[part]:03d}.exr", truth)
        count[part] += 1
        image = pycolmap.Image()
        image.name, image.image_id, image.camera_id = f"{stem}_1.png", number + 1, 1
        motion = pycolmap.Rigid3d(pycolmap.Rotation3d([0, 0, 0, 1]), [-x, -y, 0.0])
        model.add_image_with_trivial_frame(image, motion)
    for x, y in np.random.default_rng(3).uniform(-1, 1, (300, 2)):
        model.add_point3D([x, y, AWAY], pycolmap.Track())
    (folder / "exposure.json").write_text(json.dumps(times))
    (folder / "sparse" / "0").mkdir(parents=True)
    model.write(str(folder / "sparse" / "0"))
    return folder

"""The painted wall in the layout of RealX3D: dark photographs, clean ones, a model, a laser."""

import json
from io import BytesIO
from pathlib import Path

import numpy as np
from PIL import Image

from imaging.colour.spaces import srgb_encode
from imaging.files.colmap import pycolmap
from imaging.files.photo import encode_png
from tests.rig.benchmarks.painted_wall import AWAY, CENTRES, FOCAL, HEIGHT, WIDTH, light, put

METRES = 1.5
"""Of a unit of the model."""
DARKER = 8.0
"""Light of the clean photographs over that of the dark ones."""
TESTED = (1, 4, 7)


def jpeg(codes: np.ndarray) -> bytes:
    data = BytesIO()
    Image.fromarray(codes).save(data, "JPEG", quality=98, subsampling=0)
    return data.getvalue()


def realx3d_scene(root: Path, condition: str = "lowlight") -> Path:
    """Write data_4/CONDITION/Wall and pointclouds/Wall; the scene's folder."""
    folder, laser = root / "data_4" / condition / "Wall", root / "pointclouds" / "Wall"
    frames: dict[str, list[dict]] = {"train": [], "val": [], "test": []}
    model = pycolmap.Reconstruction()
    camera = pycolmap.Camera.create_from_model_name(1, "PINHOLE", FOCAL, WIDTH, HEIGHT)
    camera.params = [FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2]
    model.add_camera_with_trivial_rig(camera)
    for number, (x, y) in enumerate(CENTRES):
        name = f"{number + 1:04d}.JPG"
        clean = 6 * light((x, y))
        parts = {"test": clean} if number in TESTED else {"train": clean / DARKER, "val": clean}
        for part, shown in parts.items():
            put(folder / part / name, jpeg(np.rint(255 * srgb_encode(shown)).astype(np.uint8)))
            # the lists have a rescaled world of their own, which the import has no use for
            pose = np.diag([1.0, -1.0, -1.0, 1.0])
            pose[:2, 3] = 0.4 * np.array([x, y])
            frames[part].append({"file_path": f"{part}/{name}", "transform_matrix": pose.tolist()})
        image = pycolmap.Image()
        image.name, image.image_id, image.camera_id = name, number + 1, 1
        motion = pycolmap.Rigid3d(pycolmap.Rotation3d([0, 0, 0, 1]), [-x, -y, 0.0])
        model.add_image_with_trivial_frame(image, motion)
        depth = np.full((2 * HEIGHT, 2 * WIDTH, 1), round(1000 * METRES * AWAY), np.uint16)
        depth[:4] = 0
        put(laser / "depth" / f"{number + 1:04d}.png", encode_png(depth))
    rng = np.random.default_rng(3)
    for x, y in rng.uniform(-1, 1, (300, 2)):
        model.add_point3D([x, y, AWAY], pycolmap.Track())
    (folder / "sparse" / "0").mkdir(parents=True)
    model.write(str(folder / "sparse" / "0"))
    top = {"w": WIDTH, "h": HEIGHT, "fl_x": FOCAL, "fl_y": FOCAL, "cx": WIDTH / 2, "cy": HEIGHT / 2}
    for part, listed in frames.items():
        (folder / f"transforms_{part}.json").write_text(json.dumps(top | {"frames": listed}))
    np.save(laser / "colmap2world.npy", np.diag([METRES, METRES, METRES, 1.0]))
    return folder

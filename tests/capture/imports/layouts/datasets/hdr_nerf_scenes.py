"""Scenes in the layouts of HDR-NeRF, and where their views see a point."""

import json
from pathlib import Path

import numpy as np

from capture.imports.photos import import_photos
from imaging.files.colmap import pycolmap
from imaging.files.exr.writing import write_exr
from imaging.files.photo import encode_png
from imaging.session.calibration import read_calibration
from imaging.session.session import Session

TIMES = (0.125, 0.5, 2.0, 8.0, 32.0)
CENTRES = [(4, 0.5, 1), (3, 2, 1.5), (1, 3.5, 0.5), (-2, 3, 1)]
POINTS = np.random.default_rng(2).uniform(-0.5, 0.5, (20, 3))


def png(seed: int, size=(48, 64)) -> bytes:
    return encode_png(np.random.default_rng(seed).integers(0, 256, (*size, 3), dtype=np.uint8))


def axes(centre) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Right, up and back, in the world, of a camera that looks at the origin; z is up."""
    back = np.array(centre, float) / np.linalg.norm(centre)
    right = np.cross([0, 0, 1.0], back)
    right /= np.linalg.norm(right)
    return right, np.cross(back, right), back


def expected_pixels(centre, focal=70.0, middle=(32.0, 24.0)) -> np.ndarray:
    """Project by the definition of a pinhole, with no matrix that a convention could hide in."""
    right, up, back = axes(centre)
    away = POINTS - centre
    depth = -(away @ back)
    return np.stack([middle[0] + focal * (away @ right) / depth, middle[1] - focal * (away @ up) / depth], 1)


def rendered(folder: Path, lit: bool = True) -> Path:
    """Write a scene for the authors' loader of rendered scenes."""
    angle = 2 * np.arctan(32 / 70.0)
    number = 0
    for split, centres in (("train", CENTRES[:2]), ("test", CENTRES[2:])):
        frames, times = [], {}
        for n, centre in enumerate(centres):
            right, up, back = axes(centre)
            motion = np.eye(4)
            motion[:3] = np.stack([right, up, back, centre], axis=1)
            name = f"./{split}/{n:03d}"
            frames.append({"file_path": name, "transform_matrix": motion.tolist()})
            for step, time in enumerate(TIMES):
                path = folder / f"{name}_{step}.png"
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(png(10 * number + step))
                times[f"{name}_{step}.png"] = time
            if lit:
                write_exr(folder / f"{split}_hdr" / f"hdr_{n:03d}.exr", light(number))
            number += 1
        (folder / f"transforms_{split}.json").write_text(
            json.dumps({"camera_angle_x": angle, "frames": frames})
        )
        (folder / f"exposure_{split}.json").write_text(json.dumps(times))
    return folder


def light(number: int, size=(48, 64)) -> np.ndarray:
    return np.full((*size, 3), 1.0 + number, np.float32)


def table() -> np.ndarray:
    rows = []
    for centre in CENTRES:
        right, up, back = axes(centre)
        pose = np.stack([-up, right, back, centre, (96, 128, 140.0)], axis=1)  # twice the size of the photos
        rows += [[*pose.ravel(), 1.0, 9.0, time] for time in TIMES]
    return np.array(rows)


def photographed(folder: Path, rows=None) -> Path:
    """Write a scene for the authors' loader of photographed scenes."""
    for view in range(len(CENTRES)):
        for step in range(len(TIMES)):
            path = folder / "input_images" / f"{view:03d}_{step}.png"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(png(10 * view + step))
    np.save(folder / "poses_bounds_exps.npy", table() if rows is None else rows)
    return folder


def handed_on(folder: Path, lit=(0, 1, 2, 3)) -> Path:
    """Write a scene for HDR-GS: a COLMAP model of the second exposure of every view."""
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_frames_per_rig, options.num_points3D = 1, 4, 30
    options.camera_width, options.camera_height = 64, 48
    options.camera_model_id = pycolmap.CameraModelId.PINHOLE
    options.camera_params = [70.0, 70.0, 32.0, 24.0]
    pycolmap.set_random_seed(5)
    model = pycolmap.synthesize_dataset(options)
    for view, image in enumerate(model.images.values()):
        image.name = f"{view}_1.png"
        for step in range(5):
            path = folder / "images" / f"{view}_{step}.png"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(png(10 * view + step))
        if view in lit:
            write_exr(folder / "exr" / f"{view}.exr", light(view))
    (folder / "sparse" / "0").mkdir(parents=True)
    model.write(str(folder / "sparse" / "0"))
    return folder


def imported(folder: Path, **options):
    result = import_photos(folder, folder.parent / "s", **options)
    session = Session.open(folder.parent / "s")
    return result, session, read_calibration(session.folder)

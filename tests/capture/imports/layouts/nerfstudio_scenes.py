"""Scenes in the layout of nerfstudio."""

import json
from pathlib import Path

import numpy as np

from capture.imports.photos import import_photos
from imaging.files.photo import encode_png
from imaging.session.session import Session

LENS = {"fl_x": 70.0, "fl_y": 72.0, "cx": 33.0, "cy": 22.5, "w": 64, "h": 48}
TERMS = {"k1": -0.1, "k2": 0.03, "p1": 0.004, "p2": -0.003}
PNG = encode_png(np.random.default_rng(1).integers(0, 256, (48, 64, 3), dtype=np.uint8))


def looking_at(centre, target=(0.0, 0.0, 0.0)) -> np.ndarray:
    """world_from_cam in OpenGL's axes of a camera that looks at a target; z is up."""
    back = np.asarray(centre, float) - target
    back /= np.linalg.norm(back)
    right = np.cross([0, 0, 1.0], back)
    right /= np.linalg.norm(right)
    motion = np.eye(4)
    motion[:3] = np.stack([right, np.cross(back, right), back, centre], axis=1)
    return motion


CENTRES = [(4, 0.5, 1), (3, 2, 1.5), (1, 3.5, 0.5), (-2, 3, 1)]


def frames(**extra):
    return [
        {"file_path": f"images/{n}.png", "transform_matrix": looking_at(centre).tolist()} | extra
        for n, centre in enumerate(CENTRES)
    ]


def scene(folder: Path, value, photos=4) -> Path:
    (folder / "images").mkdir(parents=True, exist_ok=True)
    for n in range(photos):
        (folder / "images" / f"{n}.png").write_bytes(PNG)
    (folder / "transforms.json").write_text(value if isinstance(value, str) else json.dumps(value))
    return folder


def imported(folder: Path, **options):
    result = import_photos(folder, folder.parent / "s", **options)
    session = Session.open(folder.parent / "s")
    return result, session, {Path(s.source).name: (s.camera, s.frame) for s in session.shots()}

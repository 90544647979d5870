"""Real photographs, scaled: views stand where they were published, lenses are what files say."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from calib.calibrate import calibrate
from capture.imports.photos import import_photos
from imaging.session.calibration import CalibrationRecord
from imaging.session.session import Session


def calibrated(files: list[Path], long_side: int, folder: Path) -> tuple[CalibrationRecord, dict[int, str]]:
    """Copies of photographs with what their files say, calibrated; the name of each frame's photograph."""
    (folder / "photographs").mkdir()
    for path in files:
        with Image.open(path) as picture:
            factor = long_side / max(picture.size)
            size = (round(picture.width * factor), round(picture.height * factor))
            exif = {"exif": picture.info["exif"]} if "exif" in picture.info else {}
            small = picture.resize(size, Image.Resampling.LANCZOS)
            small.save(folder / "photographs" / path.name, quality=95, subsampling=0, **exif)
    import_photos(folder / "photographs", folder / "S", bracket=1)
    record = calibrate(folder / "S")
    shots = Session.open(folder / "S").shots("scene")
    return record, {shot.frame: Path(shot.source or "").name for shot in shots}


def test_frames_of_a_telephone_stand_where_they_were_published(real: Path, tmp_path: Path) -> None:
    """Frames before a patterned wallpaper, exposed automatically, without EXIF."""
    published = {
        Path(frame["file_path"]).name: np.array(frame["transform_matrix"])[:3, 3]
        for frame in json.loads((real / "fox" / "transforms.json").read_text())["frames"]
    }
    files = sorted((real / "fox" / "images").glob("*.jpg"))[:10]
    record, names = calibrated(files, 400, tmp_path)
    assert len(record.views) == len(files)
    assert not record.doubts
    poses = [view.cam_from_world.matrix() for view in record.views]
    ours = np.stack([-pose[:3, :3].T @ pose[:3, 3] for pose in poses])
    goal = np.stack([published[names[view.frame]] for view in record.views])
    a, b = ours - ours.mean(0), goal - goal.mean(0)
    u, s, vt = np.linalg.svd(b.T @ a)
    sign = np.diag([1.0, 1.0, np.linalg.det(u @ vt)])
    away = np.linalg.norm(np.trace(np.diag(s) @ sign) / (a**2).sum() * a @ (u @ sign @ vt).T - b, axis=1)
    assert np.median(away) < 0.01 * np.linalg.norm(np.ptp(goal, axis=0))


def test_a_drone_above_flat_ground_has_the_lens_of_its_files(real: Path, tmp_path: Path) -> None:
    """20 mm equivalent are 1,111 px in 2,000, of which the ground tells nothing.

    A photograph of something else, by another camera that states its focal length too, is left out.
    """
    files = sorted((real / "brighton").glob("*.JPG"))[:12]
    record, names = calibrated([*files, real / "banana" / "DSC_0431.JPG"], 400, tmp_path)
    assert {names[view.frame] for view in record.views} == {path.name for path in files}
    camera, stranger = sorted(record.cameras, key=lambda one: one.lens is None)
    assert camera.lens is not None
    assert stranger.lens is None
    assert camera.lens.fx == pytest.approx(1111 * 0.2, rel=0.05)
    assert not camera.lens.model.endswith("FISHEYE")
    assert any(rung.name == "lens_focal_undetermined" and rung.taken for rung in record.rungs)

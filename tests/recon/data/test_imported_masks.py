"""Masks from the folder of a data set to the pixels that a training looks at."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from capture.imports.photos import import_photos
from imaging.files.colmap import pycolmap
from imaging.files.exr.writing import write_exr
from imaging.session.session import Session
from recon.data.dataset import Dataset
from recon.data.load import load

HEIGHT, WIDTH = 24, 32


def mask(path: Path, number: int) -> np.ndarray:
    """A mask of its own for each picture, written to `path`."""
    counts = np.ones((HEIGHT, WIDTH), bool)
    counts[4 : 8 + 2 * number, 6:20] = False
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), 255 * counts.astype(np.uint8))
    return counts


def masks_of(dataset: Dataset) -> dict[str, np.ndarray]:
    """Mask of each view, by the name of its photograph."""
    source = {shot.file: shot.source for shot in Session.open(dataset.session).shots()}
    return {Path(str(source[view.shots[0].file])).name: view.valid for view in dataset.views}


@pytest.mark.parametrize("brought", ["transforms", "folder"])
def test_masks_of_exr_of_nerfstudio(brought: str, tmp_path: Path) -> None:
    """Named by the data set itself, or given by hand; a file without a number is not seen either."""
    folder, expected, frames = tmp_path / "photos", {}, []
    folder.mkdir()
    rng = np.random.default_rng(0)
    for number in range(4):
        light = rng.uniform(0.1, 5.0, (HEIGHT, WIDTH, 3)).astype(np.float32)
        light[0, number] = np.nan
        write_exr(folder / f"{number}.exr", light)
        pose = np.eye(4)
        pose[0, 3] = number
        frames.append({"file_path": f"{number}.exr", "transform_matrix": pose.tolist()})
        expected[f"{number}.exr"] = np.ones((HEIGHT, WIDTH), bool)
        if number:
            place = folder if brought == "transforms" else tmp_path
            expected[f"{number}.exr"] = mask(place / "masks" / f"{number}.png", number)
            if brought == "transforms":
                frames[-1]["mask_path"] = f"masks/{number}.png"
        expected[f"{number}.exr"][0, number] = False
    top = {"w": WIDTH, "h": HEIGHT, "fl_x": 40.0, "frames": frames}
    (folder / "transforms.json").write_text(json.dumps(top))
    import_photos(folder, tmp_path / "S", masks=None if brought == "transforms" else tmp_path / "masks")
    masks = masks_of(load(tmp_path / "S"))
    assert masks.keys() == expected.keys()
    for name, counts in expected.items():
        np.testing.assert_array_equal(masks[name], counts)


def test_masks_beside_a_colmap_project(tmp_path: Path) -> None:
    """images/a/1.png has masks/a/1.png.png; a photograph without one counts as a whole."""
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_cameras_per_rig, options.num_frames_per_rig = 1, 1, 4
    options.num_points3D, options.camera_width, options.camera_height = 40, WIDTH, HEIGHT
    options.camera_model_id = pycolmap.CameraModelId.PINHOLE
    options.camera_params = [40.0, 40.0, WIDTH / 2, HEIGHT / 2]
    pycolmap.set_random_seed(5)
    truth = pycolmap.synthesize_dataset(options)
    folder = tmp_path / "project"
    (folder / "sparse" / "0").mkdir(parents=True)
    truth.write(str(folder / "sparse" / "0"))
    expected, rng = {}, np.random.default_rng(1)
    for number, image in enumerate(truth.images.values()):
        path = folder / "images" / image.name
        path.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(path), rng.integers(20, 200, (HEIGHT, WIDTH, 3), dtype=np.uint8))
        expected[path.name] = np.ones((HEIGHT, WIDTH), bool)
        if number:
            expected[path.name] = mask(folder / "masks" / f"{image.name}.png", number)
    import_photos(folder, tmp_path / "S")
    masks = masks_of(load(tmp_path / "S"))
    assert len(masks) == len(expected) == 4
    for name, counts in expected.items():
        np.testing.assert_array_equal(masks[name], counts)

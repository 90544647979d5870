"""Cameras for other programs, read back by pycolmap and by what nerfstudio's format says."""

import json
from pathlib import Path

import numpy as np
import pytest

from imaging.errors import InputError
from imaging.files.colmap import pycolmap
from imaging.lens import project
from recon.exports.export import export
from recon.result.scene import Scene


def test_colmap_projects_points_as_the_views_do(scene: Scene, tmp_path: Path) -> None:
    told = export(scene, tmp_path / "cameras", "cameras")
    assert [path.relative_to(tmp_path).as_posix() for path in told.files][-1] == "cameras/transforms.json"
    model = pycolmap.Reconstruction(str(tmp_path / "cameras" / "colmap"))
    points = np.random.default_rng(0).normal(scene.record.world.origin, 0.8, (20, 3))
    images = {image.name: image for image in model.images.values()}
    assert len(images) == len(scene.views) == 4
    for view in scene.views:
        image = images[view.shots[0].file]
        motion = view.cam_from_world.matrix()
        expected = project(view.lens, points @ motion[:3, :3].T + motion[:3, 3])
        found = np.array([image.project_point(point) for point in points])
        assert np.abs(found - expected).max() < 1e-6


def test_nerfstudio_has_the_same_centres_and_axes(scene: Scene, tmp_path: Path) -> None:
    export(scene, tmp_path, "cameras")
    told = json.loads((tmp_path / "transforms.json").read_text())
    assert told["camera_model"] == "OPENCV"
    for view, frame in zip(scene.views, told["frames"], strict=True):
        pose = np.array(frame["transform_matrix"])
        motion = view.cam_from_world.matrix()
        assert np.allclose(pose[:3, 3], -motion[:3, :3].T @ motion[:3, 3])
        assert np.allclose(pose[:3, :3].T, [[1], [-1], [-1]] * motion[:3, :3])
        assert (frame["fl_x"], frame["cx"], frame["k1"]) == (view.lens.fx, view.lens.cx, view.lens.k1)


def test_a_file_in_the_place_of_the_folder_is_refused(scene: Scene, tmp_path: Path) -> None:
    (tmp_path / "there").touch()
    with pytest.raises(InputError, match="is a file, and cameras fill a folder"):
        export(scene, tmp_path / "there", "cameras")

"""Cameras for other programs, read back by pycolmap and by what nerfstudio's format says."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from imaging.colour.spaces import srgb_encode
from imaging.errors import InputError
from imaging.files.colmap import pycolmap
from imaging.optics.lens import project
from recon.exports.export import export
from recon.rendering.cameras.placement import placement_of
from recon.result.scene import Scene, open_scene


def test_colmap_projects_points_as_the_views_do(scene: Scene, tmp_path: Path) -> None:
    exported = export(scene, tmp_path / "cameras", "cameras")
    assert all(path.is_file() for path in exported.files)
    model = pycolmap.Reconstruction(str(tmp_path / "cameras" / "colmap"))
    points = np.random.default_rng(0).normal(scene.record.world.origin, 0.8, (20, 3))
    images = {image.name: image for image in model.images.values()}
    assert len(images) == len(scene.views) == 4
    for view in scene.views:
        image = images[view.id.image_name]
        motion = view.cam_from_world.matrix()
        expected = project(view.lens, points @ motion[:3, :3].T + motion[:3, 3])
        projected = np.array([image.project_point(point) for point in points])
        assert np.abs(projected - expected).max() < 1e-6


def test_nerfstudio_has_the_same_centres_and_axes(scene: Scene, tmp_path: Path) -> None:
    export(scene, tmp_path, "cameras")
    transforms = json.loads((tmp_path / "transforms.json").read_text())
    assert transforms["camera_model"] == "OPENCV"
    for view, frame in zip(scene.views, transforms["frames"], strict=True):
        pose = np.array(frame["transform_matrix"])
        motion = view.cam_from_world.matrix()
        assert np.allclose(pose[:3, 3], -motion[:3, :3].T @ motion[:3, 3])
        assert np.allclose(pose[:3, :3].T, [[1], [-1], [-1]] * motion[:3, :3])
        assert (frame["fl_x"], frame["cx"], frame["k1"]) == (view.lens.fx, view.lens.cx, view.lens.k1)


def test_a_file_in_the_place_of_the_folder_is_refused(scene: Scene, tmp_path: Path) -> None:
    (tmp_path / "there").touch()
    with pytest.raises(InputError, match="is a file, and cameras fill a folder"):
        export(scene, tmp_path / "there", "cameras")


def test_a_model_has_as_many_cameras_as_there_are_and_a_rig_of_what_is_mounted(
    scene: Scene, tmp_path: Path
) -> None:
    export(scene, tmp_path, "cameras")
    model = pycolmap.Reconstruction(str(tmp_path / "colmap"))
    assert (model.num_cameras(), model.num_rigs(), model.num_frames(), model.num_images()) == (2, 1, 2, 4)
    by_name = {view.name: view for view in scene.views}
    tipped = by_name["0001/a.1"].model_copy(update={"cam_from_world": by_name["0000/a.1"].cam_from_world})
    views = tuple(tipped if view is by_name["0001/a.1"] else view for view in scene.views)
    record = scene.record.model_copy(update={"views": views})
    export(replace(scene, record=record), tmp_path / "loose", "cameras")
    loose = pycolmap.Reconstruction(str(tmp_path / "loose" / "colmap"))
    assert (loose.num_cameras(), loose.num_rigs(), loose.num_frames(), loose.num_images()) == (2, 2, 4, 4)
    for view in views:
        (image,) = (image for image in loose.images.values() if image.name == view.id.image_name)
        np.testing.assert_allclose(
            image.cam_from_world().matrix(), view.cam_from_world.matrix()[:3], atol=1e-12
        )


def test_pictures_and_points_that_are_named_are_there(scene: Scene, tmp_path: Path) -> None:
    exported = export(scene, tmp_path, "cameras")
    assert "drawn pictures" in exported.notes[0]
    transforms = json.loads((tmp_path / "transforms.json").read_text())
    model = pycolmap.Reconstruction(str(tmp_path / "colmap"))
    for view, frame in zip(scene.views, transforms["frames"], strict=True):
        assert frame["file_path"] == f"images/{view.id.image_name}"
        shown = np.asarray(Image.open(tmp_path / frame["file_path"]), np.float64)
        expected = 255 * srgb_encode(np.clip(scene.render(view).astype(np.float64) * scene.exposure, 0, 1))
        assert np.abs(shown - expected).max() <= 0.51
    assert all((tmp_path / "images" / image.name).is_file() for image in model.images.values())
    cloud = trimesh.load(tmp_path / transforms["ply_file_path"])
    points = [model.points3D[number] for number in sorted(model.points3D)]
    assert 100 < len(points) == len(cloud.vertices) < 400
    np.testing.assert_allclose(cloud.vertices, [point.xyz for point in points], rtol=1e-6, atol=1e-6)
    np.testing.assert_array_equal(cloud.colors[:, :3], [point.color for point in points])
    assert np.ptp(cloud.colors[:, :3].astype(int)) > 200


def test_the_points_state_the_offset_that_they_lack(scene: Scene, tmp_path: Path) -> None:
    record = scene.record.model_copy(update={"offset": (1000.0, -2000.0, 0.5)})
    export(replace(scene, record=record), tmp_path, "cameras")
    assert placement_of(tmp_path / "sparse_pc.ply").offset == record.offset
    export(scene, tmp_path / "near", "cameras")
    assert b"offset" not in (tmp_path / "near" / "sparse_pc.ply").read_bytes().partition(b"end_header")[0]


def test_photographs_of_the_session_are_taken_where_they_are(made: Path, tmp_path: Path) -> None:
    """At their own size, with the lens of that; the scene may lie on another disk, linked to from there."""
    folder = tmp_path / "S" / "reconstructions" / "one"
    shutil.copytree(made, tmp_path / "disk" / "one")
    (tmp_path / "S").mkdir()
    (tmp_path / "S" / "session.json").touch()
    folder.parent.symlink_to(tmp_path / "disk")
    scene = open_scene(folder)
    for view in scene.views:
        path = tmp_path / "S" / "calibration" / "previews" / view.id.image_name
        path.parent.mkdir(parents=True, exist_ok=True)
        Image.new("RGB", (96, 72), (view.frame, 2, 3)).save(path)
    exported = export(scene, tmp_path / "out", "cameras")
    assert exported.notes == ()
    frames = json.loads((tmp_path / "out" / "transforms.json").read_text())["frames"]
    model = pycolmap.Reconstruction(str(tmp_path / "out" / "colmap"))
    for view, frame in zip(scene.views, frames, strict=True):
        assert (frame["w"], frame["h"], frame["fl_x"]) == (96, 72, 2 * view.lens.fx)
        assert Image.open(tmp_path / "out" / frame["file_path"]).getpixel((5, 5)) == (view.frame, 2, 3)
    assert {camera.width for camera in model.cameras.values()} == {96}
    # A file of splats in the same session has lenses without distortion, which are of no photograph.
    file = tmp_path / "S" / "exports" / "scene.usdc"
    file.parent.mkdir()
    export(scene, file)
    exported = export(file, tmp_path / "of_file", "cameras")
    assert "the photographs of 4 views" in exported.notes[0]

"""Cameras of browsers and of scenes."""

import json
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imaging.optics.lens import rays
from imaging.session.paths import find_reconstruction
from recon.data.geometry import project
from recon.result.scene import Scene, open_scene
from rig.view.pages.browser_cameras import splat_camera, start_of
from rig.view.serving.first import FirstPicture
from rig.view.serving.start_view import height_angle, pose_of


def held_as(scene: Scene, orientation: int) -> Scene:
    """The scene, had its files stated that its photographs were held so."""
    views = tuple(view.model_copy(update={"orientation": orientation}) for view in scene.views)
    return replace(scene, record=scene.record.model_copy(update={"views": views}))


@dataclass
class Browser:
    wxyz: np.ndarray
    position: np.ndarray
    fov: float
    aspect: float


def test_a_browser_looks_along_its_axis_with_its_field_of_view() -> None:
    turn = Rotation.from_euler("xyz", [0.4, -0.9, 2.0])
    browser = Browser(turn.as_quat(scalar_first=True), np.array([1.0, -2.0, 0.5]), 0.8, 1.5)
    camera = splat_camera(browser, 300)
    assert (camera.width, camera.height) == (300, 200)
    top = np.tan(0.4)
    ahead = np.array([[0, 0, 1], [0, top, 1], [0, -top, 1], [1.5 * top, 0, 1]]) * 3.0
    pixels, depth = project(camera, turn.apply(ahead) + browser.position)
    np.testing.assert_allclose(pixels, [[150, 100], [150, 200], [150, 0], [300, 100]], atol=1e-9)
    np.testing.assert_allclose(depth, 3.0)


def test_a_pose_comes_back(scene) -> None:
    opened = open_scene(find_reconstruction(scene))
    for view in opened.views:
        camera = opened.record.world.camera(view.splat_camera)
        wxyz, position = pose_of(camera.cam_from_world)
        browser = Browser(wxyz, position, height_angle(view.lens), camera.width / camera.height)
        again = splat_camera(browser, camera.width)
        np.testing.assert_allclose(again.cam_from_world, camera.cam_from_world, atol=1e-9)
        assert again.fy == pytest.approx(camera.fy, rel=0.05)  # of a lens with distortion


def test_a_page_begins_upright_where_a_view_stands(scene) -> None:
    """The rig's cameras are held upright, in a world whose z is up."""
    opened = open_scene(find_reconstruction(scene))
    view = opened.views[0]
    start = start_of(opened, view)
    assert np.linalg.norm(start.up) == pytest.approx(1)
    assert start.up[2] > 0.8
    ahead = np.subtract(start.look_at, start.position)
    np.testing.assert_allclose(ahead, view.cam_from_world.matrix()[2, :3], atol=1e-9)


def test_a_page_of_pictures_that_files_turn_begins_upright(scene) -> None:
    opened = open_scene(find_reconstruction(scene))
    start, stored = (start_of(one, one.views[0]) for one in (held_as(opened, 3), opened))
    np.testing.assert_allclose(start.up, np.negative(stored.up), atol=1e-9)


def test_a_portrait_is_as_high_in_the_window_as_its_lens_saw(scene) -> None:
    opened = open_scene(find_reconstruction(scene))
    view = opened.views[0]
    middle = [[0.0, view.lens.cy], [view.lens.width, view.lens.cy]]
    ends = rays(view.lens, middle)
    assert start_of(held_as(opened, 6), held_as(opened, 6).views[0]).fov == pytest.approx(
        np.arccos(ends[0] @ ends[1])
    )


def test_the_first_picture_is_one_that_the_scene_drew(scene) -> None:
    folder = find_reconstruction(scene)
    opened, first = open_scene(folder), FirstPicture.of(folder)
    view = opened.view(first.view)
    truth = opened.render(view.splat_camera)
    np.testing.assert_allclose(first.light, truth, rtol=1e-3, atol=1e-3 * truth.max())
    assert first.exposure == opened.exposure
    expected = start_of(opened, view)
    np.testing.assert_allclose(first.start.position, expected.position, atol=1e-9)
    np.testing.assert_allclose(first.start.up, expected.up, atol=1e-6)
    model = json.loads((folder / "model.json").read_text())
    for one in model["views"]:
        one["orientation"] = 6
    (folder / "model.json").write_text(json.dumps(model))
    held, again = open_scene(folder), FirstPicture.of(folder)
    np.testing.assert_array_equal(again.light, first.light[::-1].swapaxes(0, 1))  # the left side is up
    expected = start_of(held, held.view(first.view))
    np.testing.assert_allclose(again.start.up, expected.up, atol=1e-6)
    assert again.start.fov == pytest.approx(expected.fov)
    (folder / "model.json").write_text("{}")
    assert FirstPicture.of(folder) is None

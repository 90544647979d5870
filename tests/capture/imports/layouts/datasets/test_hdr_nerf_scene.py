"""The scenes that bench/ makes in the layout of HDR-NeRF are what its protocol says, when imported."""

import numpy as np
import pytest

from bench.support import hdr_nerf_scene as scenes
from capture.imports.photos import import_photos
from drivers.sim.scene.tabletop import LAMP, demo_scene
from imaging.files.photo import read_photo
from imaging.session.calibration import read_calibration
from imaging.session.session import Session, brackets
from recon.data.load import load
from recon.measure.truth import true_radiance


def test_an_imported_scene_holds_the_codes_of_the_true_light_and_every_other_view_back(tmp_path):
    scenes.write_scene(tmp_path / "scene", scenes.Size(24, 3, 3), seed=1, samples=1)
    import_photos(tmp_path / "scene", tmp_path / "s")
    session, calibration = Session.open(tmp_path / "s"), read_calibration(tmp_path / "s")
    dataset = load(tmp_path / "s")
    assert (len(dataset.train), len(dataset.held_out)) == (5, 4)
    scene = demo_scene().brightened(scenes.TOP / LAMP)
    poses = {view.frame: view.cam_from_world.matrix() for view in calibration.views}
    for view in dataset.views:
        light = true_radiance(tmp_path / "s", view)
        lens = calibration.camera(view.camera).lens
        np.testing.assert_allclose(light, scene.render(lens, poses[view.frame], 1), rtol=1e-4, atol=1e-7)
        for shot in view.shots:
            reinhard = light * shot.k / (1 + light * shot.k)
            np.testing.assert_allclose(shot.pixels, reinhard ** (1 / 2.2), atol=0.51 / 255)
    for group in brackets(session.shots()).values():
        assert [shot.reported.time for shot in group] == [0.125, 0.5, 2.0, 8.0, 32.0]
        assert read_photo(session.file(group[0])).pixels.shape == (24, 24, 3)
    centres = np.array([view.centre for view in dataset.train])
    nearest = [np.linalg.norm(centres - view.centre, axis=1).min() for view in dataset.held_out]
    assert max(nearest) < 1.2  # a view for testing has one for training beside it


def test_the_curve_is_that_of_the_data_set():
    assert scenes.curve(np.array(0.0)) == pytest.approx(0.73, abs=5e-4)  # the unit exposure of HDR-NeRF
    codes = scenes.curve(np.log([1e-6, 1.0, 1e6]))
    assert codes[0] < 0.5 / 255
    assert codes[2] > 254.5 / 255

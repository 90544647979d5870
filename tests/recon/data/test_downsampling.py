"""A view at a smaller width: the same light and the same places as where its files are read at that width."""

from dataclasses import replace

import numpy as np
import pytest

from imaging.sensor.cfa import Cfa
from recon.data.downsampling import narrower
from recon.data.geometry import project
from recon.data.load import load
from recon.data.shot import HeldPlanes, Shot


def alike(one, other):
    """Hold a smaller view against the same one read from its files at half the width."""
    assert one.sensor.cfa == other.sensor.cfa
    assert one.lens.lens == pytest.approx(other.lens.lens, rel=1e-12)
    assert (one.lens.width, one.lens.height) == (other.lens.width, other.lens.height)
    assert one.sensor.falloff == pytest.approx(other.sensor.falloff, rel=2e-3)
    for ours, file in zip(one.shots, other.shots, strict=True):
        assert (ours.k, ours.band, ours.ceiling) == (file.k, file.band, file.ceiling)
        for mask in ("saturated", "dark", "valid"):
            assert np.array_equal(getattr(ours, mask), getattr(file, mask)), mask


def test_a_mosaic_is_demosaicked_as_its_file_is_at_half_the_width(toy, toy_dataset):
    one, other = narrower(toy_dataset.train[0], 32, {}), load(toy, max_width=32).train[0]
    alike(one, other)
    for ours, file in zip(one.shots, other.shots, strict=True):
        assert np.array_equal(ours.pixels, file.pixels)


def test_a_photograph_is_averaged_in_its_light_as_its_file_is(toy_ldr):
    one, other = narrower(load(toy_ldr).train[0], 32, {}), load(toy_ldr, max_width=32).train[0]
    alike(one, other)
    for ours, file in zip(one.shots, other.shots, strict=True):
        assert ours.pixels == pytest.approx(file.pixels, abs=1e-4)


def test_a_point_of_the_scene_stays_where_it_is_in_the_picture(toy_dataset):
    view, xyz = toy_dataset.train[1], toy_dataset.points().xyz
    odd = replace(view, lens=replace(view.lens, width=63, height=47), shots=(mosaic(47, 63),))
    small = narrower(replace(odd, sensor=replace(odd.sensor, falloff=np.ones((47, 63), np.float32))), 31, {})
    assert (small.lens.width, small.lens.height) == (31, 23)
    assert project(small.lens, xyz)[0] == pytest.approx(project(view.lens, xyz)[0] / 2)


def mosaic(height, width, valid=None):
    """A shot of nothing but middle grey."""
    mask = np.zeros((height, width), bool)
    pixels = np.full((height, width), 0.5, np.float32)
    return Shot("file", 1.0, HeldPlanes(pixels, mask, mask, ~mask if valid is None else valid))


def test_what_a_mask_hides_is_hidden_in_a_smaller_mosaic_too_and_a_defect_is_not(toy_dataset):
    view = toy_dataset.train[0]
    valid = np.ones((48, 64), bool)
    valid[:, :21] = False
    valid[30, 40] = False
    (shot,) = narrower(replace(view, shots=(mosaic(48, 64, valid),)), 32, {}).shots
    assert not shot.valid[:, :11].any()
    assert shot.valid[:, 11:].all()
    assert shot.pixels[:, 11:] == pytest.approx(0.5, abs=1e-4)


def test_a_mosaic_of_larger_cells_stays_whole(toy_dataset):
    view = toy_dataset.train[0]
    other = replace(view, sensor=replace(view.sensor, cfa=Cfa.X_TRANS), shots=(mosaic(48, 60),))
    other = replace(other, lens=replace(view.lens, width=60))
    assert narrower(other, 30, {}) is other


def test_views_of_one_camera_have_one_falloff(toy_dataset):
    falloffs, views = {}, [view for view in toy_dataset.train if view.camera == toy_dataset.train[0].camera]
    small = [narrower(view, 32, falloffs).sensor.falloff for view in views]
    assert len(small) > 1
    assert all(one is small[0] for one in small)

"""Depth maps as views have them, and their scale, against the simulator's surfaces."""

import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from bench.support.depths import add_depths, true_depth
from imaging.errors import InputError
from recon.data.load import again, load
from recon.data.measured_depth import fit


def unit(dataset) -> float:
    return dataset.world.unit


@pytest.fixture(scope="module")
def exact(toy, tmp_path_factory) -> Path:
    """Exact depth, in quarters of what its records say."""
    folder = shutil.copytree(toy, tmp_path_factory.mktemp("exact") / "S")
    add_depths(folder, noise=0.0, holes=0.1, seed=1, unit=0.25e-3)
    return folder


def test_views_have_the_depth_that_was_measured_and_its_holes(exact):
    dataset = load(exact)
    for view in dataset.views[:2]:
        depth, truth = view.depth.read(view) * unit(dataset), true_depth(dataset, view)
        known = depth > 0
        assert 0.85 < known.mean() < 0.95
        np.testing.assert_allclose(0.25 * depth[known], truth[known], atol=0.26e-3)


def test_maps_are_read_at_any_width(exact):
    small = load(exact, max_width=32)
    view = small.train[0]
    depth, truth = view.depth.read(view) * unit(small), true_depth(small, view)
    known = depth > 0
    assert depth.shape == (24, 32)
    assert np.median(np.abs(0.25 * depth[known] / truth[known] - 1)) < 0.01


def test_scene_points_tell_the_unit_and_a_data_set_keeps_it(exact):
    dataset = load(exact)
    fitted = fit(dataset.train, *dataset.tracks())
    assert fitted.fits
    assert fitted.scale == pytest.approx(0.25, rel=0.01)
    assert fitted.scatter < 0.02
    scaled = dataset.with_depths(fitted.scale)
    for one in (scaled, again(scaled, 32, lambda message, done, total: None)):
        view = one.train[0]
        depth, truth = view.depth.read(view), true_depth(one, view) / unit(one)
        assert np.median(np.abs(depth[depth > 0] / truth[depth > 0] - 1)) < 0.01
    assert scaled.with_depths(None).train[0].depth is None


def test_points_without_tracks_tell_it_too(exact):
    dataset = load(exact)
    fitted = fit(dataset.train, dataset.points().xyz, {})
    assert fitted.scale == pytest.approx(0.25, rel=0.02)


def test_what_fits_no_scene_is_told_so(exact, toy_dataset):
    dataset = load(exact)
    assert fit(toy_dataset.train, *dataset.tracks()) is None
    few = fit(dataset.train[:1], dataset.points().xyz[:5], {})
    assert not few.fits
    assert "and 30 are needed to find their scale" in few.summary()
    mixed = [
        replace(view, depth=other.depth if number % 2 else replace(other.depth, unit=3 * other.depth.unit))
        for number, (view, other) in enumerate(zip(dataset.train, dataset.train[::-1], strict=True))
    ]
    bad = fit(mixed, *dataset.tracks())
    assert not bad.fits
    assert f"scatter by {100 * bad.scatter:.2g} %" in bad.summary()


def test_maps_that_say_nothing_tell_no_scale(exact, tmp_path):
    dataset = load(exact)
    cv2.imwrite(str(tmp_path / "empty.png"), np.zeros((48, 64), np.uint16))
    empty = [replace(view, depth=replace(view.depth, path=tmp_path / "empty.png")) for view in dataset.train]
    fitted = fit(empty, *dataset.tracks())
    assert (fitted.looks, fitted.fits) == (0, False)
    assert np.isfinite([fitted.scale, fitted.scatter]).all()


def test_masks_and_alpha_hide_depth_and_a_missing_map_is_named(exact, tmp_path):
    view = load(exact).train[0]
    known = view.depth.read(view) > 0
    valid = np.ones(view.shots[0].shape, bool)
    valid[:10] = False
    masked = replace(view, shots=tuple(shot.showing(valid=valid) for shot in view.shots))
    np.testing.assert_array_equal(view.depth.read(masked) > 0, known & (np.arange(48) >= 10)[:, None])
    alpha = np.ones((48, 64), np.float32)
    alpha[:, 20:] = 0.2
    cut = replace(view, shots=tuple(shot.showing(alpha=alpha) for shot in view.shots))
    np.testing.assert_array_equal(view.depth.read(cut) > 0, known & (np.arange(64) < 20))
    with pytest.raises(InputError, match=r"gone\.png cannot be read .* import again without depths"):
        replace(view.depth, path=tmp_path / "gone.png").read(view)


def test_between_a_near_and_a_far_surface_is_nothing(exact, tmp_path):
    """A scanner of 8x6 pixels: a slope, a card before it, and a hole."""
    view = load(exact).train[0]
    coarse = np.tile(np.linspace(1.0, 1.14, 8, dtype=np.float32), (6, 1))
    coarse[:, 4:] = 3.0
    coarse[0, 0] = 0
    np.save(tmp_path / "a.npy", coarse)
    depth = replace(view.depth, path=tmp_path / "a.npy", unit=2.0).read(view)
    x = (np.arange(64) + 0.5) / 8 - 0.5
    np.testing.assert_allclose(depth[24, 4:28], 2 * (1 + 0.02 * x[4:28]), rtol=1e-5)
    assert set(np.unique(depth[:, 32:])) == {6.0}
    assert depth[24, :32].max() < 2.2
    assert (depth[:8, :8] == 0).sum() == 64

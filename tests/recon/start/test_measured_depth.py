"""Measured depth replaces a sweep at the start."""

from dataclasses import replace

import numpy as np
import pytest

from bench.support.depths import true_depth
from recon.data.geometry import project
from recon.data.light import radiance_image
from recon.data.load import load
from recon.data.measured_depth import fit
from recon.start import plane_sweep as sweeping
from recon.start.plane_sweep import plane_sweep, sample


@pytest.fixture(scope="module")
def dataset(toy_deep):
    loaded = load(toy_deep)
    return loaded.with_depths(fit(loaded.train, *loaded.tracks()).scale)


@pytest.fixture(scope="module")
def images(dataset):
    return [radiance_image(view) for view in dataset.train]


def test_its_points_lie_on_what_was_measured_and_nothing_is_swept(dataset, images, monkeypatch):
    monkeypatch.setattr(sweeping, "_sweep_one", lambda *_: pytest.fail("a measured view was swept"))
    maps = plane_sweep(dataset.train, images, dataset.points().xyz)
    assert [one.view for one in maps] == list(dataset.train)
    for one in maps:
        truth = true_depth(dataset, one.view) / dataset.world.unit
        known = one.view.depth.read(one.view) > 0
        np.testing.assert_array_equal(one.trusted, known)
        assert np.isfinite(one.depth).all()
        assert np.percentile(np.abs(one.depth[known] / truth[known] - 1), 95) < 0.03
    points = sample(maps, 400, np.random.Generator(np.random.PCG64(0)))
    pixels, _ = project(dataset.train[0].lens, points)
    assert len(points) == 400
    assert np.isfinite(pixels).all()


def test_views_without_a_map_are_swept_beside_them(dataset, images):
    empty = replace(dataset.train[1], depth=None)
    views = (dataset.train[0], empty, *dataset.train[2:])
    maps = plane_sweep(views, images, dataset.points().xyz)
    assert [one.view for one in maps] == list(views)
    assert 0 < maps[1].trusted.mean() < 1
    truth = true_depth(dataset, empty) / dataset.world.unit
    off = np.abs(maps[1].depth / truth - 1)[maps[1].trusted]
    assert np.median(off) < 0.05


def test_a_map_that_says_nothing_is_as_good_as_none(dataset, images, tmp_path):
    np.save(tmp_path / "nan.npy", np.full((48, 64), np.nan))
    view = dataset.train[0]
    blind = replace(view, depth=replace(view.depth, path=tmp_path / "nan.npy"))
    bare = replace(view, depth=None)
    ours, theirs = (
        plane_sweep((one, *dataset.train[1:]), images, dataset.points().xyz)[0] for one in (blind, bare)
    )
    np.testing.assert_array_equal(ours.depth, theirs.depth)

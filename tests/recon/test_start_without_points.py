"""Poses that came from elsewhere, without scene points."""

import numpy as np
import pytest

from imaging.colmap import pycolmap, read_points
from imaging.errors import ReconstructionError
from recon.dataset import load
from recon.geometry import project
from recon.radiance import radiance_image
from recon.start import start_points
from recon.truth import true_radiance


@pytest.fixture
def pointless(session_copy):
    """The toy session with the poses of its truth, and a COLMAP model without points."""
    folder = session_copy / "calibration" / "colmap"
    xyz = read_points(folder).xyz
    model = pycolmap.Reconstruction(str(folder))
    for key in list(model.points3D):
        model.delete_point3D(key)
    model.write(str(folder))
    dataset = load(session_copy)
    return dataset, dataset.world.from_world(xyz)


def test_points_are_found_where_the_scene_is(pointless):
    dataset, xyz = pointless
    images = [radiance_image(view) for view in dataset.train]
    start = start_points(dataset, images, 3000, np.random.Generator(np.random.PCG64(0)))
    assert start.sparse > 100
    assert len(start.xyz) > 2500
    for view in dataset.train:
        own, known = project(view.lens, start.xyz)[1], project(view.lens, xyz)[1]
        assert np.median(own) == pytest.approx(np.median(known), rel=0.15)
    light = np.median([np.median(true_radiance(dataset.session, view)) for view in dataset.train])
    assert 0.3 * light < np.median(start.rgb) < 3 * light


def test_views_that_share_nothing_are_refused(pointless):
    dataset, _ = pointless
    rng = np.random.default_rng(1)
    images = [
        (rng.random((view.lens.height, view.lens.width, 3)).astype(np.float32), None)
        for view in dataset.train
    ]
    with pytest.raises(ReconstructionError, match="scene points"):
        start_points(dataset, images, 100, rng)

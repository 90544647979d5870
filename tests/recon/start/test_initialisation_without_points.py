"""Poses that came from elsewhere, without scene points."""

import numpy as np
import pytest

from drivers.sim.rigs import simulate
from imaging.errors import ReconstructionError
from imaging.files import store
from imaging.files.colmap import pycolmap, read_points
from recon.data.geometry import inside, project
from recon.data.light import radiance_image
from recon.data.load import load
from recon.measure.truth import true_radiance
from recon.start.initialisation import start_points


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
    dataset, _ = pointless
    images = [radiance_image(view) for view in dataset.train]
    start = start_points(dataset, images, 3000, np.random.Generator(np.random.PCG64(0)))
    assert start.sparse > 100
    assert len(start.xyz) > 2500
    truth = store.read_json(dataset.session / "truth" / "truth.json")
    points = dataset.world.to_world(start.xyz)
    scene, off = simulate(truth["rig"], truth["seed"]).scene, []
    for view in dataset.train:
        centre = np.linalg.inv(dataset.world.camera_in_world(view.lens).cam_from_world)[:3, 3]
        reach = np.linalg.norm(points - centre, axis=1)
        visible = inside(view.lens, *project(view.lens, start.xyz))
        surface = scene.depth(np.broadcast_to(centre, points.shape), (points - centre) / reach[:, None])
        off.append((reach / surface)[visible & np.isfinite(surface)])
    # Of each view's rays, half meet the surface within 4 % of the point; what is hidden lies behind it.
    assert np.median(np.abs(np.log(np.concatenate(off)))) < 0.04
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

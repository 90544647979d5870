"""Turns of pairs, as far as the model has the lenses of both views."""

from types import SimpleNamespace

import numpy as np

from calib.data.features import MatchedPair
from calib.poses.checks.loops import turns_of
from imaging.files.colmap import pycolmap
from imaging.session.view_id import ViewId


def test_a_pair_with_a_camera_that_the_model_does_not_hold_has_no_turn():
    rng = np.random.default_rng(0)
    world = np.column_stack([rng.uniform(-6, 6, (100, 2)), rng.uniform(15, 25, 100)])
    index = np.repeat(np.arange(100, dtype=np.uint32)[:, None], 2, axis=1)
    one, other = (
        1000 * place[:, :2] / place[:, 2:] + (600, 400) for place in (world, world - (2.0, 0.0, 0.0))
    )
    pair = MatchedPair(one, other, index)
    views = [ViewId(0, "placed"), ViewId(1, "placed"), ViewId(0, "lost")]
    camera = pycolmap.Camera.create_from_model_name(7, "SIMPLE_RADIAL", 1000, 1200, 800)
    model = SimpleNamespace(
        images={1: SimpleNamespace(name=views[0].image_name, camera_id=7)}, cameras={7: camera}
    )
    pairs = {(views[0], views[1]): pair, (views[0], views[2]): pair, (views[2], views[1]): pair}
    (turn,) = turns_of(model, pairs, 4.0).items()
    assert turn[0] == (views[0], views[1])
    np.testing.assert_allclose(turn[1], np.eye(3), atol=1e-3)

"""Focal lengths that files tell, in scenes that tell them and in scenes that do not."""

import numpy as np
import pytest

from bench.calibration import tracks
from calib.adjustment.bundle_adjustment import Free, adjust, drop_outliers
from calib.adjustment.focal_evidence import CHANGE, DETERMINED, effect
from calib.adjustment.focal_priors import FocalPrior
from calib.adjustment.lens_ladder import climb
from calib.adjustment.uncertainty import standard_errors
from imaging.files.colmap import pycolmap
from imaging.progress import unreported
from tests.calib.adjustment.test_uncertainty import made, residuals

SCALE = 0.35


def adjusted(kind, free=None, seed=0):
    """A noisy scene, begun with at its truth."""
    free = free or Free()
    model = tracks.noisy(tracks.truth(kind, seed, (-0.05,)), seed)
    adjust(model, free, SCALE, 1)
    drop_outliers(model, 0.6)
    adjust(model, free, SCALE, 1)
    return model


@pytest.mark.parametrize(
    ("kind", "determined"),
    [
        ("flat flight", False),
        ("flight over houses", True),
        ("walk ahead", True),
        ("walk aside", True),
        ("ring", True),
    ],
)
def test_flat_ground_seen_straight_down_does_not_tell_the_focal_length(kind, determined):
    shift = effect(adjusted(kind), Free(), SCALE)[1]
    assert (shift >= DETERMINED * tracks.WIDTH) == determined


def test_a_fixed_lens_is_not_asked_for():
    assert effect(adjusted("ring"), Free(fixed=frozenset({1})), SCALE) == {}


@pytest.mark.parametrize("model", ["SIMPLE_RADIAL", "OPENCV"])
def test_a_held_focal_length_stays_and_poses_are_as_unsure_as_it_makes_them(model):
    sure, unsure = (Free(model, focal={1: FocalPrior(820.0, spread, held=True)}) for spread in (0.8, 40.0))
    fitted = adjusted("flat flight", sure)
    assert fitted.cameras[1].mean_focal_length() == pytest.approx(820.0, rel=1e-4)
    stated = [standard_errors(fitted, free, SCALE, unreported) for free in (sure, unsure)]
    assert stated[0].lenses["made"]["fx"] == pytest.approx(0.8, rel=0.3)
    assert stated[1].lenses["made"]["fx"] == pytest.approx(40.0, rel=0.3)


def test_a_prior_counts_by_its_spread_and_that_of_the_points():
    """The points of a flat flight tell the focal length to 5 %, those of a ring to 0.04 %."""
    free = [Free(focal={1: FocalPrior(840.0, spread)}) for spread in (1e4, 20.0, 0.5)]
    open_, between, tight = (adjusted("flat flight", one).cameras[1].params[0] for one in free)
    low, high = sorted((open_, 840.0))
    assert low < between < high
    assert tight == pytest.approx(840.0, abs=0.5)
    assert adjusted("ring", free[1]).cameras[1].params[0] == pytest.approx(tracks.FOCAL, rel=2e-3)
    np.testing.assert_allclose(adjusted("ring", free[0]).cameras[1].params[3], -0.05, atol=5e-3)


def test_a_prior_of_a_camera_without_a_placed_view_does_nothing():
    """A photograph of another camera among others, which shares no points with them."""
    alone = Free(focal={1: FocalPrior(840.0, 20.0)})
    beside = Free(focal={**alone.focal, 2: FocalPrior(500.0, 1.0)})
    assert beside.within(tracks.truth("ring", 0, (-0.05,))) == alone


def test_a_middle_aside_is_not_taken_for_a_tilt_over_flat_ground():
    free = Free(focal={1: FocalPrior(820.0, 25.0, held=True)})
    chosen, rungs = climb(adjusted("flat flight", free), free, SCALE, 1, unreported)
    assert not chosen.principal_point
    assert chosen.model in ("SIMPLE_RADIAL", "RADIAL")
    (middle,) = [rung for rung in rungs if rung.name == "lens_principal_point"]
    assert not middle.taken
    assert "does not determine the principal point" in middle.reason


def test_the_effect_is_that_on_the_camera_of_the_focal_length():
    """One of two cameras, held at a longer focal length, moves its own points so much."""
    truth = made(3)
    change = 0.1 * CHANGE
    held = FocalPrior((1 + change) * truth.cameras[1].mean_focal_length(), 1.0, held=True)
    model = pycolmap.Reconstruction(truth)
    camera = model.cameras[1]
    camera.params = [held.px, *camera.params[1:]]
    for _ in range(3):
        adjust(model, Free(focal={1: held}), 10.0, 1)
    of_camera = np.concatenate(
        [np.full(image.num_points3D, image.camera_id == 1) for _, image in sorted(model.images.items())]
    )
    moved = np.sqrt((residuals(model)[of_camera] ** 2).sum(1).mean())
    assert moved == pytest.approx(effect(truth, Free(), 10.0)[1] * change / CHANGE, rel=0.2)

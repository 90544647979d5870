"""Terms of a lens against lenses that are known."""

from typing import Any

import numpy as np
import pytest

from calib.adjustment import lens_ladder
from calib.adjustment.bundle_adjustment import Free
from imaging.files.colmap import pycolmap
from imaging.progress import unreported

NOISE = 0.3
"""px, of a standard deviation."""


def synthesized(seed: int, lens: list[float], frames: int, track: int) -> Any:
    """A scene without noise, seen by one camera, each of 300 points in at most `track` views."""
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_cameras_per_rig, options.num_frames_per_rig = 1, 1, frames
    options.num_points3D, options.num_points2D_without_point3D, options.track_length = 300, 0, track
    options.camera_width, options.camera_height = 640, 480
    options.camera_params = lens
    pycolmap.set_random_seed(seed)
    return pycolmap.synthesize_dataset(options)


def with_noise(model: Any, seed: int, noise: float) -> Any:
    """The same with corners that are off by so many pixels, in a standard deviation."""
    rng = np.random.default_rng(seed)
    for index in sorted(model.reg_image_ids()):
        for point in model.image(index).points2D:
            point.xy = np.ravel(point.xy) + rng.normal(0, noise, 2)
    return model


def views(seed: int, radial: float, frames: int = 6) -> Any:
    """Views of a camera with one radial term."""
    return with_noise(synthesized(seed, [640.0, 320.0, 240.0, radial], frames, 4), seed, NOISE)


def terms(seed: int, radial: float, frames: int = 6) -> list[str]:
    """Those that are taken."""
    _, rungs = lens_ladder.climb(views(seed, radial, frames), Free(), NOISE, 1, unreported)
    return [rung.name for rung in rungs if rung.taken]


@pytest.fixture(scope="module")
def taken():
    return [terms(seed, -0.5) for seed in range(20)]


def test_the_term_that_a_lens_has_is_taken(taken):
    assert all("lens_radial_1" in names for names in taken)


def test_terms_that_it_has_not_are_left_out(taken):
    """By two standard errors one or two of sixty trials are taken by chance; by one, nine would be."""
    assert sum(len(names) - 1 for names in taken) <= 3


def test_four_views_are_enough_for_a_lens_that_is_bent():
    """They tell much by hardly more than a standard error: by two, half of these would stay straight."""
    assert sum("lens_radial_1" in terms(seed, -0.2, frames=4) for seed in range(10)) >= 8


def test_a_straight_lens_stays_straight():
    """By chance one of forty trials is taken."""
    taken = [name for seed in range(10) for name in terms(seed, 0.0)]
    assert len(taken) <= 2
    assert taken.count("lens_radial_1") <= 1


def test_three_views_judge_nothing():
    free, (rung,) = lens_ladder.climb(views(0, -0.5, frames=3), Free(), NOISE, 1, unreported)
    assert free == Free()
    assert not rung.taken
    assert "fewer than 4 views" in rung.reason


def test_what_was_not_cut_decides_on_nothing_but_a_fisheye():
    """An axis off the middle bends long walks, and shows in exact places alone."""
    model = synthesized(3, [500.0, 326.0, 236.0, -0.1], 10, 5)
    uncut = with_noise(pycolmap.Reconstruction(model), 3, 3.0)
    with_noise(model, 4, 0.02)
    for camera in (*model.cameras.values(), *uncut.cameras.values()):
        camera.params = [500.0, 320.0, 240.0, -0.1]
    climbed, rungs = lens_ladder.climb(model, Free(), 0.02, 1, unreported, uncut=uncut)
    taken = {rung.name: rung.taken for rung in rungs}
    assert taken["lens_principal_point"]
    assert climbed.principal_point
    assert not taken["lens_fisheye"]


def test_a_view_counts_by_what_it_sees_of_the_held_out_points() -> None:
    """Ten views of 200 points gain 0.1 each; one that sees two loses 7, and hides that in a mean of views."""
    rng = np.random.default_rng(0)
    observations = np.array([200] * 10 + [2])
    gains = observations * np.append(rng.normal(0.1, 0.02, 10), -7.0)
    mean, error = lens_ladder.mean_gain(gains, observations)
    assert mean == pytest.approx(0.1, abs=0.02)
    assert error < 0.01
    assert (gains / observations).mean() < 0
    alike = lens_ladder.mean_gain(gains[:10], observations[:10])
    each = gains[:10] / 200
    assert alike == pytest.approx((each.mean(), each.std(ddof=1) / 10**0.5))
    assert lens_ladder.mean_gain(np.zeros(4), np.zeros(4)) == (0.0, 0.0)


def stretched(seed: int, by: float, noise: float) -> Any:
    """Views whose pixels are higher than wide by this factor."""
    model = synthesized(seed, [640.0, 320.0, 240.0, 0.0], 10, 5)
    for index in sorted(model.reg_image_ids()):
        for point in model.image(index).points2D:
            x, y = np.ravel(point.xy)
            point.xy = np.array([x, 240.0 + by * (y - 240.0)])
    return with_noise(model, seed, noise)


def tangential(model: Any, noise: float) -> Any:
    """The rung of tangential terms and two focal lengths."""
    _, rungs = lens_ladder.climb(model, Free(), noise, 1, unreported)
    return next(rung for rung in rungs if rung.name == "lens_tangential")


@pytest.mark.parametrize("seed", range(3))
def test_pixels_that_are_not_square_have_to_save_more_than_noise_does(seed: int) -> None:
    """Noise of three pixels lets focal lengths be 3 % apart, and saves up to 0.04 by it."""
    assert tangential(stretched(seed, 1.07, NOISE), NOISE).taken
    assert tangential(stretched(seed, 1.004, NOISE), NOISE).taken  # of a lens that is hardly so
    noisy = tangential(stretched(seed, 1.03, 3.0), 3.0)
    assert not noisy.taken
    assert noisy.gain < 0.05
    assert "pixels are square" in noisy.reason

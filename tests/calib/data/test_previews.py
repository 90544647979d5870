"""The pictures that features are found in, of scenes with known noise."""

import numpy as np
from scipy import ndimage

from calib.data.features import extract
from calib.data.previews import blurred, enlargement, preview
from imaging.merge.bracket import Merged


def scene(light: float, noise: float, seed: int) -> Merged:
    """A smooth pattern of brightness 0.1 to 1 times `light`, [120, 160, 3]."""
    pattern = ndimage.gaussian_filter(np.random.default_rng(1).normal(size=(120, 160)), 2.0)
    pattern = 0.1 + 0.9 * (pattern - pattern.min()) / np.ptp(pattern)
    radiance = light * np.repeat(pattern[..., None], 3, axis=2)
    radiance += np.random.default_rng(seed).normal(0, noise, radiance.shape)
    every = np.ones(radiance.shape, bool)
    sigma = np.full(radiance.shape, noise, np.float32)
    return Merged(radiance.astype(np.float32), sigma, every, ~every, ~every)


def alike(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.corrcoef(one.ravel(), other.ravel())[0, 1])


def test_two_faint_pictures_of_a_scene_look_alike() -> None:
    faint = [preview(scene(1.0, 0.2, seed)) for seed in (1, 2)]
    clear = preview(scene(1.0, 1e-4, 3))
    assert alike(*faint) > 0.8  # 0.42 without smoothing
    assert alike(faint[0], clear) > 0.9


def test_a_scene_with_light_enough_keeps_its_detail() -> None:
    fine = Merged(*(np.array(part) for part in vars(scene(1.0, 0.01, 1)).values() if part is not None))
    fine.radiance[::2] *= 0.8
    rows = preview(fine).mean(1)
    assert np.abs(np.diff(rows)).min() > 0.05


def test_a_wide_blur_of_a_reduced_picture_is_the_blur() -> None:
    steps = np.random.default_rng(4).normal(size=(301, 403))
    picture = np.cumsum(np.cumsum(steps, axis=0), axis=1)
    for radius in (8.0, 25.0, 40.0):
        exact = ndimage.gaussian_filter(picture, radius)
        assert np.abs(blurred(picture, radius) - exact).std() < 5e-3 * picture.std()


def test_a_strip_is_enlarged_no_more_than_its_length_allows() -> None:
    assert [enlargement(width, 480) for width in (640, 639, 320, 160)] == [1, 1, 2, 4]
    assert enlargement(120, 480) == 5  # as upright as pictures are
    assert enlargement(2, 900) == 4
    assert enlargement(1, 40_000) == 1
    assert len(extract(np.zeros((900, 2), np.float32)).points) == 0

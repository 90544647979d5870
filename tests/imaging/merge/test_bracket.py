"""Merging against the Cramér-Rao bound, and at the edges: all saturated, all dark, one frame, no number."""

import numpy as np
import pytest

from imaging.merge.bracket import ROWS, merge_bracket
from imaging.merge.linear_frame import LinearFrame, SensorSignalNoise, from_codes, from_light
from imaging.session.calibration import Response

FULL_WELL, READ = 15_000.0, 4.0
NOISE = SensorSignalNoise(slope=1 / FULL_WELL, floor=(READ / FULL_WELL) ** 2)
SCALES = tuple(4.0**-n for n in range(5))


def expose(radiance: np.ndarray, k: float, rng: np.random.Generator, noise=NOISE) -> LinearFrame:
    electrons = rng.poisson(np.minimum(radiance * k, 3.0) * FULL_WELL) + READ * rng.standard_normal(
        radiance.shape
    )
    signal = np.minimum(electrons / FULL_WELL, 1.0).astype(np.float32)
    none = np.zeros(signal.shape, bool)
    return LinearFrame(signal, k, signal >= 1.0, none, ~none, noise=noise, ceiling=1.0)


def bound(radiance: float) -> float:
    """Relative standard deviation that no unbiased merge can beat, counting unsaturated frames only."""
    used = [k for k in SCALES if radiance * k + 3 * np.sqrt(NOISE.variance(radiance * k)) < 1]
    return float(1 / np.sqrt(sum(k**2 / NOISE.variance(radiance * k) for k in used)) / radiance)


@pytest.mark.parametrize("radiance", [1e-4, 1e-3, 1e-2, 1e-1, 0.9, 1.0, 10.0, 50.0, 200.0])
def test_meets_the_bound_without_bias_and_says_its_own_sigma(radiance: float) -> None:
    rng = np.random.default_rng(np.random.PCG64(7))
    truth = np.full((200, 200), radiance)
    merged = merge_bracket([expose(truth, k, rng) for k in SCALES])
    error = merged.radiance[merged.valid] / radiance - 1
    assert merged.valid.all()
    assert error.std() <= bound(radiance) * 1.06
    assert abs(error.mean()) < 0.05 * error.std()
    assert merged.sigma is not None
    whitened = (merged.radiance - radiance) / merged.sigma
    # near the noise floor sigma follows the noise of its own pixel, which costs a few percent
    assert np.mean(whitened**2) == pytest.approx(1.0, abs=0.05 if radiance >= 1e-2 else 0.1)


def test_without_a_noise_model_the_sums_are_unbiased_too() -> None:
    rng = np.random.default_rng(np.random.PCG64(8))
    for radiance in (1e-3, 1e-1, 10.0):
        frames = [expose(np.full((150, 150), radiance), k, rng, noise=None) for k in SCALES]
        merged = merge_bracket(frames)
        error = merged.radiance / radiance - 1
        assert merged.sigma is None
        assert error.std() < 1.7 * bound(radiance)
        assert abs(error.mean()) < 0.05 * error.std()


def test_order_of_the_frames_does_not_matter() -> None:
    rng = np.random.default_rng(np.random.PCG64(9))
    frames = [expose(np.geomspace(1e-3, 100, 600).reshape(20, 30), k, rng) for k in SCALES]
    a, b = merge_bracket(frames), merge_bracket(frames[::-1])
    np.testing.assert_array_equal(a.radiance, b.radiance)


def test_all_saturated_is_the_shortest_frame_as_a_bound() -> None:
    rng = np.random.default_rng(np.random.PCG64(10))
    truth = np.full((4, 4), 1e4)
    merged = merge_bracket([expose(truth, k, rng) for k in SCALES])
    assert merged.clipped.all()
    assert not merged.valid.any()
    assert merged.sigma is not None
    assert np.isinf(merged.sigma).all()
    np.testing.assert_allclose(merged.radiance, 1 / SCALES[-1])


def test_all_dark_keeps_the_negatives() -> None:
    rng = np.random.default_rng(np.random.PCG64(11))
    merged = merge_bracket([expose(np.zeros((200, 200)), k, rng) for k in SCALES])
    assert merged.valid.all()
    assert (merged.radiance < 0).mean() == pytest.approx(0.5, abs=0.02)
    assert abs(merged.radiance.mean()) < 0.05 * merged.radiance.std()


def test_one_frame_is_itself() -> None:
    rng = np.random.default_rng(np.random.PCG64(12))
    frame = expose(np.geomspace(1e-3, 10, 400).reshape(20, 20), 0.25, rng)
    merged = merge_bracket([frame])
    np.testing.assert_allclose(merged.radiance, frame.signal / 0.25, rtol=1e-6)
    np.testing.assert_array_equal(merged.clipped, frame.saturated)
    np.testing.assert_array_equal(merged.valid, ~frame.saturated)


def test_no_number_stays_where_it_is() -> None:
    light = np.ones((3, 3, 3), np.float32)
    light[1, 1, 0] = np.nan
    other = np.ones((3, 3, 3), np.float32)
    other[0, 0, 2] = np.inf
    both = merge_bracket([from_light(light, 1.0), from_light(other, 1.0)])
    assert both.valid.all()
    np.testing.assert_allclose(both.radiance, 1.0)
    alone = merge_bracket([from_light(light, 1.0)])
    assert np.isnan(alone.radiance[1, 1, 0])
    assert (~alone.valid).sum() == 1
    assert np.isfinite(np.delete(alone.radiance.ravel(), 12)).all()


def test_code_values_at_both_ends_only_bound() -> None:
    response = Response(kind="srgb", evidence="assumed")
    codes = np.full((1, 3, 3), 0.5, np.float32)
    codes[0, 0], codes[0, 2] = 0.0, 1.0
    merged = merge_bracket([from_codes(codes, 2.0, response)])
    assert merged.valid[0].all(axis=-1).tolist() == [False, True, False]
    assert merged.dark[0].all(axis=-1).tolist() == [True, False, False]
    assert merged.clipped[0].all(axis=-1).tolist() == [False, False, True]
    assert merged.radiance[0, 1, 0] == pytest.approx(0.21404 / 2, rel=1e-3)


def test_tall_images_are_merged_in_bands_without_a_seam() -> None:
    rng = np.random.default_rng(np.random.PCG64(13))
    frames = [expose(np.full((ROWS + 3, 2), 0.1), k, rng) for k in SCALES]
    whole = merge_bracket(frames)
    part = merge_bracket(
        [
            LinearFrame(
                f.signal[ROWS:], f.k, f.saturated[ROWS:], f.dark[ROWS:], f.valid[ROWS:], None, NOISE, 1.0
            )
            for f in frames
        ]
    )
    np.testing.assert_array_equal(whole.radiance[ROWS:], part.radiance)


def test_frames_of_two_shapes_are_refused() -> None:
    rng = np.random.default_rng(np.random.PCG64(14))
    with pytest.raises(ValueError, match="one shape"):
        merge_bracket([expose(np.ones((2, 2)), 1.0, rng), expose(np.ones((2, 3)), 1.0, rng)])
    with pytest.raises(ValueError, match="one shape"):
        merge_bracket([])
    with pytest.raises(ValueError, match="positive"):
        merge_bracket([expose(np.ones((2, 2)), 0.0, rng)])

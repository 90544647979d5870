"""Exposure ratios against known ones: rounded labels, wrong labels, motion, bridges, and a bent response."""

from itertools import combinations

import numpy as np
import pytest

from imaging.merge.linear_frame import LinearFrame, SensorSignalNoise
from imaging.merge.ratios import Ratio, linearity, overlap, ratio, solve

FULL_WELL, READ = 10_000.0, 3.0
NOISE = SensorSignalNoise(slope=1 / FULL_WELL, floor=(READ / FULL_WELL) ** 2)
SCENE = np.random.default_rng(np.random.PCG64(1))
RADIANCE = np.exp(SCENE.uniform(np.log(1e-4), np.log(4.0), (30, 40))).repeat(8, 0).repeat(8, 1)


def expose(
    k: float, seed: int, radiance: np.ndarray = RADIANCE, bend: float = 0.0, noise=NOISE
) -> LinearFrame:
    rng = np.random.default_rng(np.random.PCG64(seed))
    signal = rng.poisson(np.minimum(radiance * k, 4) * FULL_WELL) + READ * rng.standard_normal(radiance.shape)
    signal = signal / FULL_WELL
    signal = np.minimum(signal - bend * signal**2, 1.0).astype(np.float32)
    none = np.zeros(signal.shape, bool)
    return LinearFrame(signal, k, signal >= 1.0, none, ~none, noise=noise, ceiling=1.0)


@pytest.mark.parametrize("noise", [NOISE, None], ids=["noise known", "noise unknown"])
@pytest.mark.parametrize("step", [4.0, 16.0, 256.0])
def test_ratio_is_true_within_its_error_and_two_tenths_of_a_percent(step: float, noise) -> None:
    pulls = []
    for seed in range(8):
        true = step * 1.037
        measured = ratio(
            [overlap(expose(1.0, 2 * seed, noise=noise), expose(1 / true, 2 * seed + 1, noise=noise))]
        )
        assert measured is not None
        assert abs(measured.log - np.log(true)) < (2e-3 if step < 100 else 6e-3)
        pulls.append((measured.log - np.log(true)) / measured.error)
    assert np.sqrt(np.mean(np.square(pulls))) < 2.0
    assert abs(np.mean(pulls)) < 1.2


def test_a_moving_object_does_not_change_the_ratio() -> None:
    moved = RADIANCE.copy()
    moved[40:80, 60:140] = 0.3
    measured = ratio([overlap(expose(1.0, 20), expose(0.25, 21, moved))])
    assert measured is not None
    assert measured.log == pytest.approx(np.log(4.0), abs=2e-3)


def test_exposures_without_shared_photosites_have_no_ratio() -> None:
    assert ratio([overlap(expose(1e-3, 30), expose(1e-5, 31))]) is None
    white = expose(1e6, 32)
    assert ratio([overlap(white, white)]) is None
    assert ratio([]) is None


def edges_between(true: np.ndarray, pairs) -> dict[tuple[int, int], Ratio]:
    return {(i, j): Ratio(float(true[i] - true[j]), 1e-3) for i, j in pairs}


def test_rounded_labels_are_corrected_and_keep_the_common_scale() -> None:
    true = np.log(2.0 ** np.arange(-10, 0, 2))
    labels = np.log([1 / 1000, 1 / 250, 1 / 60, 1 / 15, 1 / 4])
    scales, errors = solve(labels, edges_between(true, combinations(range(5), 2)))
    np.testing.assert_allclose(np.diff(scales), np.diff(true), atol=1e-4)
    assert abs(np.mean(scales - labels)) < 0.01
    assert (errors < 2e-3).all()


def test_one_label_wrong_by_two_is_found_and_does_not_shift_the_others() -> None:
    true = np.log(4.0 ** np.arange(5))
    labels = true.copy()
    labels[3] += np.log(2)
    scales, _ = solve(labels, edges_between(true, combinations(range(5), 2)))
    np.testing.assert_allclose(scales, true, atol=0.01)


def test_labels_bridge_what_no_overlap_connects() -> None:
    true = np.log([1.0, 4.1, 4.1 * 2.0**20, 4.1 * 2.0**22])
    labels = np.log([1.0, 4.0, 4.0 * 2.0**20, 4.0 * 2.0**22])
    scales, errors = solve(
        labels, {(1, 0): Ratio(true[1] - true[0], 1e-3), (3, 2): Ratio(true[3] - true[2], 1e-3)}
    )
    assert scales[1] - scales[0] == pytest.approx(true[1] - true[0], abs=1e-4)
    assert scales[3] - scales[2] == pytest.approx(true[3] - true[2], abs=1e-4)
    assert scales[2] - scales[1] == pytest.approx(labels[2] - labels[1], abs=0.05)
    assert (errors > 0.01).all()


def test_linear_sensor_passes_and_a_bent_one_does_not() -> None:
    def check(bend: float):
        pair = [overlap(expose(1.0, s, bend=bend), expose(0.25, s + 1, bend=bend)) for s in (40, 42, 44)]
        pooled = ratio(pair)
        assert pooled is not None
        return linearity([(pooled, pair)])

    straight, bent = check(0.0), check(0.05)
    assert straight is not None
    assert bent is not None
    assert straight.deviation < 0.002
    assert bent.deviation > 0.01
    assert linearity([]) is None

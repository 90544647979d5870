"""Similarities between points, some of which are wrong, and how sure they are."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.survey.similarity import consensus, fit, is_line, standard_errors

SCALE, SHIFT = 2.5, np.array([10.0, -20.0, 3.0])


def points(count: int, noise: float, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """In the source, in the target with noise, and the rotation between."""
    rng = np.random.default_rng(seed)
    rotation = Rotation.random(rng=rng).as_matrix()
    source = rng.normal(size=(count, 3))
    return source, SCALE * source @ rotation.T + SHIFT + rng.normal(0, noise, (count, 3)), rotation


def test_a_similarity_is_found_exactly() -> None:
    source, target, rotation = points(5, 0.0, 0)
    estimated = fit(source, target)
    assert estimated.scale == pytest.approx(SCALE)
    np.testing.assert_allclose(estimated.rotation, rotation, atol=1e-12)
    np.testing.assert_allclose(estimated(source), target, atol=1e-12)
    np.testing.assert_allclose(estimated.inverse(target), source, atol=1e-12)
    assert fit(source, target, rigid=True).scale == 1.0


@pytest.mark.parametrize("count", [6, 8, 20])
def test_wrong_points_are_found(count: int) -> None:
    for seed in range(20):
        source, target, _ = points(count, 0.005, seed)
        target[[0, 1]] = target[[1, 0]]
        estimated, fits, _ = consensus(source, target, np.full(count, 0.005), stated=True)
        assert not fits[:2].any()
        assert fits[2:].sum() >= count - 3
        assert estimated.scale == pytest.approx(SCALE, rel=0.02)


@pytest.mark.parametrize("count", [3, 4, 5, 8])
def test_good_points_are_kept(count: int) -> None:
    fitting = [
        consensus(*points(count, 0.005, seed)[:2], np.full(count, 0.005), stated=True)[1].all()
        for seed in range(50)
    ]
    assert np.mean(fitting) > 0.9


@pytest.mark.parametrize("count", [3, 4, 5])
def test_few_points_that_do_not_fit_are_not_believed(count: int) -> None:
    believed = 0
    for seed in range(20):
        source, target, _ = points(count, 0.005, seed)
        target[0] = target[0] + (3.0, 0.0, 0.0)
        _, fits, _ = consensus(source, target, np.full(count, 0.005), stated=True)
        believed += fits.all()
    assert believed == 0


@pytest.mark.parametrize("factor", [1.0, 4.0])
def test_stated_errors_are_those_that_are_made(factor: float) -> None:
    """factor: by how much the noise is more than it was said to be."""
    off, stated = [], []
    for seed in range(200):
        source, target, rotation = points(12, 0.01 * factor, seed)
        noise = np.full(12, 0.01)
        estimated = fit(source, target)
        stated.append(standard_errors(target, estimated(source) - target, noise))
        turn = np.degrees(Rotation.from_matrix(estimated.rotation @ rotation.T).magnitude())
        true = SCALE * source.mean(0) @ rotation.T + SHIFT
        off.append(
            (estimated.scale / SCALE - 1, turn, np.linalg.norm(estimated(source.mean(0)[None])[0] - true))
        )
    rms, mean = np.sqrt(np.mean(np.square(off), axis=0)), np.mean(stated, axis=0)
    assert rms[0] == pytest.approx(mean[0], rel=0.2)
    assert mean[1] < rms[1] < 2 * mean[1]  # of the worst axis, and of all three
    assert mean[2] < rms[2] < 2 * mean[2]


def test_points_on_a_line_leave_a_turn_open() -> None:
    rng = np.random.default_rng(0)
    line = np.outer(np.linspace(0, 5, 6), (1, 2, 3)) + rng.normal(0, 0.01, (6, 3))
    assert is_line(line, 0.01)
    assert not is_line(line + np.outer((0, 1, 0, 1, 0, 1), (1, 0, 0)), 0.01)

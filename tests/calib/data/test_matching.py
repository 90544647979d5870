"""Matches against the definition: the two nearest of each feature, found by sorting all angles."""

import numpy as np
import pytest

from calib.data.matching import FARTHEST, RATIO, ROWS, WORTHWHILE, match, multiplies_bytes


def descriptors(rng: np.random.Generator, count: int) -> np.ndarray:
    """Make directions: no component is negative, length 1."""
    drawn = rng.exponential(size=(count, 128))
    return drawn / np.linalg.norm(drawn, axis=1, keepdims=True)


def whole(directions: np.ndarray) -> np.ndarray:
    """Make descriptors as SIFT writes them: 512 times a unit vector."""
    return np.clip(np.rint(512 * directions), 0, 255).astype(np.uint8)


def by_definition(one: np.ndarray, other: np.ndarray) -> set[tuple[int, int]]:
    one, other = (rows / np.linalg.norm(rows.astype(float), axis=1, keepdims=True) for rows in (one, other))
    angles = np.arccos(np.clip(one @ other.T, -1, 1))

    def nearest(table: np.ndarray) -> list[int | None]:
        order = np.argsort(table, axis=1)[:, :2]
        first, second = (np.take_along_axis(table, order[:, [k]], 1)[:, 0] for k in (0, 1))
        good = (first < FARTHEST) & (first < RATIO * second)
        return [int(index) if fine else None for index, fine in zip(order[:, 0], good, strict=True)]

    there, back = nearest(angles), nearest(angles.T)
    return {(i, j) for i, j in enumerate(there) if j is not None and back[j] == i}


WAYS = [False, *([True] if multiplies_bytes(WORTHWHILE) else [])]
"""Products by floats, and by bytes where the processor has instructions for them."""


@pytest.mark.parametrize("by_bytes", WAYS)
@pytest.mark.parametrize("count", [2, ROWS - 1, ROWS, 2 * ROWS + 7])
def test_matches_are_those_of_the_definition(count, by_bytes):
    rng = np.random.default_rng(count)
    one = descriptors(rng, count)
    noisy = np.abs(
        one[rng.permutation(count)] + rng.uniform(0, 0.06, (count, 1)) * rng.normal(size=one.shape)
    )
    repeated = one[: count // 8] + 1e-3 * descriptors(rng, count // 8)
    other = np.concatenate([noisy, repeated, descriptors(rng, 40)])
    other = whole(other / np.linalg.norm(other, axis=1, keepdims=True))
    one = whole(one)
    matches = {(int(a), int(b)) for a, b in match(one, other, by_bytes=by_bytes)}
    assert matches == by_definition(one, other)
    back = match(other, one, by_bytes=by_bytes)
    assert {(b, a) for a, b in matches} == {(int(a), int(b)) for a, b in back}


@pytest.mark.parametrize("by_bytes", WAYS)
def test_products_of_the_largest_numbers_do_not_saturate(by_bytes):
    rng = np.random.default_rng(3)
    one = np.repeat(np.array([[255, 255], [255, 0], [0, 255]], np.uint8), 64, axis=1).repeat(20, axis=0)
    one -= rng.integers(0, 2, one.shape, np.uint8) * (one > 0)
    other = one[rng.permutation(len(one))]
    matches = {(int(a), int(b)) for a, b in match(one, other, by_bytes=by_bytes)}
    assert matches == by_definition(one, other)
    assert len(matches) == len(one)


def test_few_products_are_not_worth_loading_torch():
    assert not multiplies_bytes(WORTHWHILE / 2)


def test_too_few_features_match_nothing():
    one = whole(descriptors(np.random.default_rng(0), 5))
    assert match(one[:1], one).shape == match(one, one[:0]).shape == (0, 2)

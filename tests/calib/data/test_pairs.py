"""Pairs that are matched: all of few views; of a walk around a place those that see the same of it."""

from itertools import combinations

import numpy as np

from calib.data.pairs import ALIKE, ALL_PAIRS, NEIGHBOURS, pairs_to_match
from imaging.session.view_id import ViewId

STRETCH = 6
"""Places that each view sees, from its own on; there are as many places as views."""


def ring(count: int, camera: str = "cam", features: int = 60) -> dict[ViewId, np.ndarray]:
    """Views in shuffled order around a place, as uint8 descriptors of what they see, with noise."""
    rng = np.random.default_rng(count)
    places = rng.exponential(30, (count, features, 128))
    order = rng.permutation(count)
    by_view = {}
    for frame, start in enumerate(order):
        visible = np.concatenate([places[(start + step) % count] for step in range(STRETCH)])
        noisy = visible + rng.normal(0, 5, visible.shape)
        by_view[ViewId(frame, camera)] = np.clip(noisy, 0, 255).astype(np.uint8)
    return {view: by_view[view] for view in sorted(by_view)}


def test_all_pairs_of_few_views():
    few = ring(ALL_PAIRS)
    assert pairs_to_match(few, []) == list(combinations(few, 2))


def test_of_many_views_those_that_see_the_same_are_matched_and_few_others():
    count = 150
    many = ring(count)
    chosen = set(pairs_to_match(many, []))
    start = np.random.default_rng(count)
    start.exponential(30, (count, 60, 128))
    order = start.permutation(count)
    views = list(many)
    apart = {
        (one, other): min(
            abs(order[one.frame] - order[other.frame]), count - abs(order[one.frame] - order[other.frame])
        )
        for one, other in combinations(views, 2)
    }
    assert {pair for pair, steps in apart.items() if steps < STRETCH} <= chosen
    assert len(chosen) <= count * (ALIKE + NEIGHBOURS)
    assert chosen == set(pairs_to_match(many, []))


def test_frames_in_a_row_and_cameras_of_a_rig_are_matched_however_little_they_look_alike():
    rng = np.random.default_rng(0)
    views = {
        ViewId(frame, camera): rng.integers(0, 255, (20, 128), dtype=np.uint8)
        for frame in range(40)
        for camera in ("left", "right", "loose")
    }
    chosen = set(pairs_to_match(views, [("left", "right")]))
    for frame in range(40):
        assert (ViewId(frame, "left"), ViewId(frame, "right")) in chosen
        for step in range(1, NEIGHBOURS + 1):
            if frame + step < 40:
                assert (ViewId(frame, "loose"), ViewId(frame + step, "loose")) in chosen


def test_views_without_features_are_no_reason_to_fail():
    many = ring(ALL_PAIRS + 1)
    many[next(iter(many))] = np.zeros((0, 128), np.uint8)
    assert pairs_to_match(many, [])

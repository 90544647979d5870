"""Regions of a scene: as many points each, of points that lie side by side."""

import numpy as np

from calib.light.tracks import FEWEST, REGIONS, regions_of


def test_regions_hold_as_many_points_each_and_do_not_overlap() -> None:
    places = np.random.default_rng(0).uniform(0, [40, 3, 1], (1000, 3))
    places[::100] *= 1e4  # stray points do not decide where a region is cut
    region = regions_of(places)
    counts = np.bincount(region)
    assert len(counts) == REGIONS
    assert counts.max() <= 2 * counts.min() + 1
    spans = sorted((places[region == n, 0].min(), np.median(places[region == n, 0])) for n in range(REGIONS))
    assert spans[-1][1] > 20 > spans[0][1]
    inside = np.delete(np.arange(1000), np.s_[::100])
    for number in range(REGIONS):
        x = places[inside][region[inside] == number, 0]
        assert np.ptp(x) < 10


def test_few_points_are_few_regions() -> None:
    assert set(regions_of(np.zeros((FEWEST - 1, 3)))) == {0}
    assert len(set(regions_of(np.random.default_rng(1).normal(size=(5 * FEWEST, 3))))) == 5
    assert regions_of(np.empty((0, 3))).shape == (0,)

"""The truth within what is stated, over made scenes that go through all that decides about a lens."""

import numpy as np
import pytest

from bench.calibration import coverage


@pytest.mark.parametrize("kind", ["flat flight", "ring"])
def test_the_truth_lies_within_what_is_stated(kind):
    """Focal lengths within 2.6 standard errors (99 %), and nine in ten axes of poses within 1.96."""
    every = [coverage.inside(kind, (-0.12,), seed) for seed in range(2)]
    assert all(value < 2.6 for ratios in every for value in ratios["focal length"])
    for what in ("turn", "place"):
        values = np.array([value for ratios in every for value in ratios[what]])
        assert np.mean(values <= coverage.WITHIN) >= 0.9

"""Turns between views, compared between programs whose worlds differ."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.real.poses.untouched import differences


def test_turns_between_views_do_not_depend_on_the_world() -> None:
    turns = Rotation.random(4, np.random.default_rng(0))
    ours = {str(number): turn.as_matrix().tolist() for number, turn in enumerate(turns)}
    elsewhere = turns * Rotation.from_euler("y", 40, degrees=True)
    theirs = {str(number): turn.as_matrix().tolist() for number, turn in enumerate(elsewhere)}
    assert differences(ours, theirs) == pytest.approx([0.0] * 6, abs=1e-5)
    off = Rotation.from_euler("x", 2, degrees=True) * turns[0]
    angles = differences(ours | {"0": off.as_matrix().tolist()}, {**theirs, "5": theirs["0"]})
    assert sorted(angles) == pytest.approx([0.0] * 3 + [2.0] * 3, abs=1e-5)

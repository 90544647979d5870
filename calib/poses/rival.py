"""Agreement of two models of the same views about how these are turned."""

from itertools import combinations
from typing import Any

import numpy as np

from calib.poses.contradictions import placed_views

SAME_TURN = 3.0
"""Degrees by which the turn between two views may differ between two models: of the same scene they differ by
less than one, of a folded one by the angle of the fold."""
FEWEST_COMMON = 3
"""Views that two models have to have in common for their turns to be compared."""


def agreement(one: Any | None, other: Any | None) -> float | None:
    """Compare the turns between the views that two pycolmap models have in common.

    Returns:
        The share of the pairs of these views whose turns agree; None where there is only one model, or they
        have too few views in common.
    """
    if one is None or other is None:
        return None
    here, there = placed_views(one), placed_views(other)
    common = sorted(here.keys() & there.keys())
    if len(common) < FEWEST_COMMON:
        return None
    least = 1 + 2 * np.cos(np.radians(SAME_TURN))
    same = [
        np.trace(_turn(here, first, second) @ _turn(there, first, second).T) >= least
        for first, second in combinations(common, 2)
    ]
    return float(np.mean(same))


def _turn(placed: dict[Any, Any], first: Any, second: Any) -> Any:
    """Rotation [3, 3] from the first to the second view."""
    return placed[second][1][:3, :3] @ placed[first][1][:3, :3].T

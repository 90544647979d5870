"""Agreement of two models of the same views, and views of one that the other does not confirm."""

from collections.abc import Collection
from itertools import combinations
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree

from calib.data.features import FEWEST_MATCHES
from calib.poses.checks.contradictions import placed_views

SAME_TURN = 3.0
"""Degrees by which the turn between two views may differ between two models: of the same scene they differ by
less than one, of a folded one by the angle of the fold."""
FEWEST_COMMON = 3
"""Views that two models have to have in common for their turns to be compared."""
FEWEST_HANGING = 7
"""Points that a view which one pair holds has to share with two others. Of fruit on a carpet one with 8
stands within a degree of where learned features put it, which match it to more views; a blurred one with 5 is
turned by 73."""


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


def joined_groups(
    pairs: Collection[tuple[Any, Any]], views: Collection[Any], tracks: Collection[Collection[Any]]
) -> list[set[Any]]:
    """Group views that more than one pair of them joins, or enough points, the largest group first.

    A group that hangs on the rest by one pair is as wrong as that pair where no third view confirms it: of
    four sides of a varnished crate each was placed right in itself, and three of them wrongly to each other,
    with 9 points at most that three views see from both sides of such a pair.

    Args:
        pairs: Views that match.
        views: Those that are grouped.
        tracks: Views that see a point, of each point of the model.
    """
    number = {view: place for place, view in enumerate(sorted(views))}
    ends = np.array(
        [(number[one], number[other]) for one, other in pairs if one in number and other in number]
    ).reshape(-1, 2)
    seen_by = [[number[view] for view in set(track)] for track in tracks if len(set(track)) >= 3]
    joined = np.ones(len(ends), bool)
    # A pair whose loss parts views lies on every tree that joins them.
    tree = set(zip(*minimum_spanning_tree(_graph(ends, len(number))).nonzero(), strict=True))
    for place, (one, other) in enumerate(ends.tolist()):
        if (one, other) in tree or (other, one) in tree:
            rest = np.delete(ends, place, axis=0)
            side = connected_components(_graph(rest, len(number)), directed=False)[1]
            if side[one] != side[other]:
                across = sum({side[one], side[other]} <= set(side[track].tolist()) for track in seen_by)
                joined[place] = across >= FEWEST_MATCHES
    every = sorted(views)
    held = [(every[one], every[other]) for one, other in ends[joined].tolist()]
    return sorted(_parts(held, views), key=len, reverse=True)


def hanging_on(
    pairs: Collection[tuple[Any, Any]], views: Collection[Any], tracks: Collection[Collection[Any]]
) -> set[Any]:
    """Those of the views outside the largest group that may be placed all the same, with a warning.

    Each of them is alone on its pair, and has some points that two other views see: all that hangs on a pair
    is turned by it, and sides of five views of a varnished crate hung on pairs that only look alike.

    Args:
        pairs: Views that match.
        views: Those that only one pair joins to the largest group.
        tracks: Views that see a point, of each point of the model.
    """
    alone = set[Any]().union(*(part for part in _parts(pairs, views) if len(part) == 1))
    shared = {view: sum(view in track and len(set(track)) >= 3 for track in tracks) for view in alone}
    return {view for view, points in shared.items() if points >= FEWEST_HANGING}


def _parts(pairs: Collection[tuple[Any, Any]], views: Collection[Any]) -> list[set[Any]]:
    """Views that pairs of them join, one after another."""
    number = {view: place for place, view in enumerate(sorted(views))}
    ends = [(number[one], number[other]) for one, other in pairs if one in number and other in number]
    labels = connected_components(_graph(np.array(ends).reshape(-1, 2), len(number)), directed=False)[1]
    return [{view for view, place in number.items() if labels[place] == one} for one in set(labels)]


def _graph(ends: Any, count: int) -> Any:
    return sparse.coo_matrix((np.ones(len(ends)), ends.T), (count, count)).tocsr()


def _turn(placed: dict[Any, Any], first: Any, second: Any) -> Any:
    """Rotation [3, 3] from the first to the second view."""
    return placed[second][1][:3, :3] @ placed[first][1][:3, :3].T

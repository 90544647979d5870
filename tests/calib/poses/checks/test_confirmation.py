"""Number of views and points that confirm poses."""

import math
from itertools import combinations

import pytest

from calib.poses.checks.confirmation import LOOSE, NAMED, loose, unconfirmed
from imaging.session.view_id import ViewId

VIEWS = [ViewId(number, "cam") for number in range(10)]


@pytest.mark.parametrize(
    ("placed", "matching", "warning"),
    [
        (4, 10, "only 4 of 10 views that match others fit together"),
        (5, 10, None),
        (2, 2, "only 2 views match, and no third confirms their poses"),
        (2, 4, "only 2 of 4 views that match others fit together"),
        (3, 4, None),
    ],
)
def test_enough_of_the_views_that_match_have_to_fit_together(placed, matching, warning):
    said = unconfirmed(VIEWS[:placed], dict.fromkeys(combinations(VIEWS[:matching], 2)), 1.0)
    assert said is None if warning is None else said.startswith(warning)


@pytest.mark.parametrize(
    ("placed", "threefold", "warning"),
    [(10, 0.49, "only 49 % of the scene's points"), (10, 0.51, None), (3, 0.0, None)],
)
def test_third_views_have_to_see_most_points_where_there_are_more_than_three(placed, threefold, warning):
    said = unconfirmed(VIEWS[:placed], dict.fromkeys(combinations(VIEWS[:placed], 2)), threefold)
    assert said is None if warning is None else said.startswith(warning)


def test_views_whose_turns_few_points_hold_are_named():
    errors = dict.fromkeys(VIEWS, 0.5 * LOOSE)
    assert loose({}, {}) is None
    assert loose(errors, {}) is None
    rung = loose(errors | {VIEWS[3]: 1.5 * LOOSE, VIEWS[7]: 2.5 * LOOSE}, {VIEWS[7]: "DSC_7.JPG"})
    assert rung.taken
    assert f"determine how {VIEWS[3]}, DSC_7.JPG are turned to 2.5 degrees only" in rung.reason
    without = loose(errors | {VIEWS[3]: math.inf}, {})
    assert f"few points determine {VIEWS[3]}: too few to determine how certain its pose is" in without.reason
    assert f"and {len(VIEWS) - NAMED} more" in loose(dict.fromkeys(VIEWS, 2.0 * LOOSE), {}).reason

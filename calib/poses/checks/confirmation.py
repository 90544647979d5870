"""Confirmation by enough views and points of poses that no pair of views contradicts.

Any two views fit together, and a few of many that match do by chance where parts of a scene look alike. Nor
does a pair contradict poses that put all views on a line, before rows of windows: then every match along a
row fits any two of them, but no third view finds the point where the two see it.
"""

from collections.abc import Collection, Mapping
from math import isinf
from typing import Any

from calib.poses.checks.brightness_steps import Pairs
from imaging.and_list import and_more
from imaging.session.calibration import POSE_HANGING, POSE_LOOSE
from imaging.session.records import Rung
from imaging.session.view_id import ViewId

LOOSE = 1.0
"""Degrees of a standard error of a view's turn, above which its pose is doubtful. Of a castle's views it is
0.04 at most, of a flight over flat ground 0.5; of a ball in pieces of one pattern 1.0 in the median, and one
of its views is turned by 3."""
NAMED = 8
"""Views that a warning names one by one."""
FEWEST_CONFIRMED = 3
"""Views that have to fit together before one confirms the others."""
MOST_LOST = 0.5
"""Share of the views that match others of which a model may lack poses and still be held to be confirmed."""
SEEN_BY_THREE = 0.5
"""Share of the points that three views or more have to see. Where poses are right it is 0.84 and more, though
the walk be straight ahead; of ten views on a line that was none it is 0.13."""


def unconfirmed(placed: Collection[ViewId], pairs: Pairs, threefold: float) -> str | None:
    """Return a warning about poses that too few other views or points confirm, or None.

    placed: the views that have a pose. pairs: of all views that match. threefold: see `seen_by_three`.
    """
    views = {view for pair in pairs for view in pair}
    if len(placed) < max(FEWEST_CONFIRMED, (1 - MOST_LOST) * len(views)):
        if len(views) == len(placed):
            return (
                f"only {len(placed)} views match, and no third confirms their poses: take more views beside "
                "them"
            )
        return (
            f"only {len(placed)} of {len(views)} views that match others fit together, and nothing confirms "
            "their poses: take more views, at most 15 degrees apart"
        )
    if len(placed) > FEWEST_CONFIRMED and threefold < SEEN_BY_THREE:
        return (
            f"only {100 * threefold:.0f} % of the scene's points are confirmed by a third view, as happens "
            "where parts of a scene look alike: put something unique beside them and take views 15 "
            "degrees apart"
        )
    return None


def seen_by_three(reconstruction: Any) -> float:
    """The share of a COLMAP model's points that are seen by three images or more; 0 where it has none."""
    tracks = [point.track.elements for point in reconstruction.points3D.values()]
    threefold = sum(len({element.image_id for element in track}) >= 3 for track in tracks)
    return threefold / max(len(tracks), 1)


def hanging(views: Collection[ViewId], names: Mapping[ViewId, str]) -> Rung | None:
    """Return a rung that names the views which one pair holds on the others, or None without any.

    Args:
        views: Those that it holds.
        names: Names that the user gave their photographs, of views that have one.
    """
    if not views:
        return None
    named = ", ".join(names.get(view, str(view)) for view in sorted(views))
    reason = (
        f"only one pair of views connects {named} to the others, and too few points that a third view sees "
        f"confirm it: {'its pose' if len(views) == 1 else 'their poses'} may be wrong; take more views "
        f"beside {'it' if len(views) == 1 else 'them'}, or leave {'it' if len(views) == 1 else 'them'} out"
    )
    return Rung(name=POSE_HANGING, taken=True, reason=reason)


def loose(turn_errors: Mapping[ViewId, float], names: Mapping[ViewId, str]) -> Rung | None:
    """Return a rung that names the views whose turns are hardly determined, or None.

    Args:
        turn_errors: Standard error of each registered view's turn, degrees; infinite where too few points
            hold it for any.
        names: Names that the user gave their photographs, of views that have one.
    """
    views = sorted(view for view, error in turn_errors.items() if error > LOOSE)
    if not views:
        return None
    worst = max(views, key=lambda view: turn_errors[view])
    named = and_more([names.get(view, str(view)) for view in views], NAMED)
    one = len(views) == 1
    if isinf(turn_errors[worst]):
        size = (
            f"few points determine {named}: too few to determine how certain "
            f"{'its pose is' if one else 'their poses are'}"
        )
    else:
        size = (
            f"the photographs determine how {named} {'is' if one else 'are'} turned to "
            f"{turn_errors[worst]:.2g} degrees only (a standard error: a pose may be wrong by three times it)"
        )
    reason = f"{size}; take more views beside {'it' if one else 'them'}, or put texture into the scene"
    return Rung(name=POSE_LOOSE, taken=True, reason=reason)

"""Confirmation by enough views and points of poses that no pair of views contradicts.

Any two views fit together, and a few of many that match do by chance where parts of a scene look alike. Nor
does a pair contradict poses that put all views on a line, before rows of windows: then every match along a
row fits any two of them, but no third view finds the point where the two see it.
"""

from collections.abc import Collection
from typing import Any

from calib.poses.brightness_steps import Pairs
from imaging.session.view_id import ViewId

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
            f"only {100 * threefold:.0f} % of the scene's points are where a third view sees them, too, as "
            "where parts of a scene look alike: put something unique beside them and take views 15 degrees "
            "apart"
        )
    return None


def seen_by_three(reconstruction: Any) -> float:
    """The share of a COLMAP model's points that are seen by three images or more; 0 where it has none."""
    tracks = [point.track.elements for point in reconstruction.points3D.values()]
    threefold = sum(len({element.image_id for element in track}) >= 3 for track in tracks)
    return threefold / max(len(tracks), 1)

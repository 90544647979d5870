"""Views that no poses can be found of, and why: nothing to see in them, or all from one place."""

from collections.abc import Mapping

import numpy as np

from calib.data.features import Features, MatchedPair
from imaging.errors import CalibrationError
from imaging.optics.lens import Lens
from imaging.session.view_id import ViewId

FEWEST_FEATURES = 40
"""A view with fewer cannot be placed."""
LEAST_PARALLAX = 0.01
"""Views that show less than this, in the median of their pairs, were taken from one place."""
MOST_ASKED = 40
"""Pairs of views that are asked whether they show depth."""


class OnePlace(CalibrationError):
    """All views were taken from one place, so that other features of them give no poses either."""


def require_features(features: Mapping[ViewId, Features], blank: Mapping[ViewId, str]) -> None:
    """Refuse views of which fewer than two have anything to hold on to.

    Raises:
        OnePlace: There is one view.
        CalibrationError: Names the commonest cause.
    """
    if len(features) < 2:
        raise OnePlace(
            "Only one view: poses need at least two, so take more views of the same scene from other places."
        )
    lost = {view: blank.get(view, "without texture or blurred") for view, of_view in features.items()
            if view in blank or len(of_view.points) < FEWEST_FEATURES}  # fmt: skip
    if len(features) - len(lost) < 2:
        causes = list(lost.values())
        cause = max(sorted(set(causes)), key=causes.count)
        fixes = {"black": "expose longer or light the scene", "saturated": "expose shorter"}
        raise CalibrationError(
            f"{len(lost)} of {len(features)} views have too few features, {causes.count(cause)} of them "
            f"are {cause}: {fixes.get(cause, 'focus, hold still, or put texture into the scene')}."
        )


def require_depth(
    pairs: Mapping[tuple[ViewId, ViewId], MatchedPair], cameras: Mapping[str, Lens], max_error: float
) -> None:
    """Raise OnePlace when all views were taken from one place, of which no model can be made."""
    every = list(pairs.items())[:: max(len(pairs) // MOST_ASKED, 1)]
    sizes = {name: (lens.width, lens.height) for name, lens in cameras.items()}
    shown = [pair.parallax(sizes[one.camera], max_error) for (one, _), pair in every]
    if float(np.median(shown)) < LEAST_PARALLAX:
        raise OnePlace(
            "The views match but show no depth, as if the camera had turned on the spot: move it sideways "
            "between views."
        )

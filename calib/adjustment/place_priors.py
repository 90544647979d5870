"""Places and attitudes of cameras that their photographs state, as terms of the bundle adjustment.

The points of a view err together, by a shutter that rolls and by what no model of a lens has: many points
place a view no better than `COMMON` of the image's width. What is stated counts against that, and not against
the noise of so many points.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from imaging.files.colmap import pycolmap

Array = npt.NDArray[np.float64]

COMMON = 3e-6
"""Of an image's width, by which the points of a view err together: what is left of a real flight's residuals,
in quarters to sixteenths of its pictures, is 1e-6 to 3e-6 beyond their noise."""
SHARE = 0.25
"""Of the square of the Cauchy loss's scale, the variance of a coordinate as far as that loss lets it count:
the scale is the median miss, 1.18 standard deviations of normal noise."""
_OPEN = 1e6
"""Standard deviation of what is not stated."""


@dataclass(frozen=True, eq=False)
class StatedPlace:
    """Where a camera stood and how it looked, in coordinates east, north and up.

    centre: [3], m, and spread: [3], its standard deviations. turn: [3, 3], camera from world; None: not
    stated. tilt, heading: its standard deviations, rad, about level axes and about the upright one.
    """

    centre: Array
    spread: Array
    turn: Array | None = None
    tilt: float = 0.0
    heading: float = 0.0

    def turn_covariance(self) -> Array:
        """Of the turn, in the camera's axes, rad^2 [3, 3]."""
        turn = np.eye(3) if self.turn is None else self.turn
        return np.asarray(turn @ np.diag([self.tilt**2, self.tilt**2, self.heading**2]) @ turn.T)


def variance(points: int, width: int, scale: float) -> float:
    """What a stated place is weighed against, px^2, in a view of so many points under a Cauchy loss."""
    return float(max(SHARE * scale**2, points * (COMMON * width) ** 2))


def add_place_priors(
    problem: Any, reconstruction: Any, places: Mapping[int, StatedPlace], scale: float
) -> list[Any]:
    """Add what is stated of images, by COLMAP's numbers, to a Ceres problem with a Cauchy loss of `scale` px.

    Returns:
        What has to live until the problem is solved: the problem does not own it.
    """
    from pycolmap import cost_functions

    added = []
    for number, place in sorted(places.items()):
        image = reconstruction.image(number)
        parameters = image.frame.rig_from_world.params
        if not problem.has_parameter_block(parameters):
            continue
        weight = variance(image.num_points3D, reconstruction.cameras[image.camera_id].width, scale)
        spread = np.diag(place.spread**2) / weight
        costs = [cost_functions.AbsolutePosePositionPriorCost(spread, place.centre)]
        if place.turn is not None:
            stated = pycolmap.Rigid3d(np.column_stack([place.turn, -place.turn @ place.centre]))
            covariance = _OPEN**2 * np.eye(6)
            covariance[:3, :3] = place.turn_covariance() / weight
            costs.append(cost_functions.AbsolutePosePriorCost(covariance, stated))
        for cost in costs:
            problem.add_residual_block(cost, None, [parameters])
        added += costs
    return added

"""Priors of camera places and attitudes from the photographs' files, as terms of the bundle adjustment.

The points of a view err together, by a shutter that rolls and by what no model of a lens has: many points
place a view no better than `COMMON` of the image's width. The priors are weighed against that, and not
against the noise of all points.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from imaging.arrays import Array
from imaging.files.colmap import pycolmap

COMMON = 3e-6
"""Common error of the points of a view, as a share of the image's width: the residuals of a real flight, in
quarters to sixteenths of its pictures, are 1e-6 to 3e-6 beyond their noise.
"""
SHARE = 0.5
"""Effective variance of a coordinate, as a share of the square of the typical residual, the median: 1.18
standard deviations of normal noise.
"""
_OPEN = 1e6
"""Standard deviation of what is not stated."""


@dataclass(frozen=True, eq=False)
class StatedPlace:
    """Prior of a camera's place and attitude, in coordinates east, north and up.

    centre: [3], m, and spread: [3], its standard deviations. turn: [3, 3], camera from world; or None. tilt,
    heading: its standard deviations, rad, about level axes and about the upright one.
    """

    centre: Array
    spread: Array
    turn: Array | None = None
    tilt: float = 0.0
    heading: float = 0.0

    def turn_covariance(self) -> Array:
        """Covariance of the rotation, in the camera's axes, rad^2 [3, 3]."""
        turn = np.eye(3) if self.turn is None else self.turn
        return np.asarray(turn @ np.diag([self.tilt**2, self.tilt**2, self.heading**2]) @ turn.T)


def variance(points: int, width: int, scale: float) -> float:
    """Variance against which a stated place is weighed, px^2, in a view with that many points under a Cauchy
    loss.
    """
    return float(max(SHARE * scale**2, points * (COMMON * width) ** 2))


def add_place_priors(
    problem: Any, reconstruction: Any, places: Mapping[int, StatedPlace], scale: float
) -> list[Any]:
    """Add what is stated of images to a Ceres problem with a Cauchy loss.

    Args:
        problem: Ceres problem of a bundle adjustment; frames that it does not have are passed over.
        reconstruction: pycolmap's, whose poses the problem adjusts, in coordinates east, north and up, m.
        places: Places and attitudes by COLMAP's numbers of the images.
        scale: Typical miss of an observation, px, against which the priors are weighed (`variance`).

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

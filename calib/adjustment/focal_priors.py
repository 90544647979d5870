"""Priors of focal lengths, as a term of the bundle adjustment."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyceres

from calib.adjustment.place_priors import SHARE

HOLDS = 1e3
"""Factor by which a focal length is held tighter than its spread where the points do not determine it."""
_ASPECT = 0.01
"""Relative difference allowed between the focal lengths across and down."""
_OPEN = 1e6
"""Standard deviation of terms that this prior leaves free."""


@dataclass(frozen=True)
class FocalPrior:
    """A focal length, px, and its standard deviation, px; held: the points are not asked."""

    px: float
    spread: float
    held: bool = False


def add_focal_priors(
    problem: Any, reconstruction: Any, priors: Mapping[int, FocalPrior], scale: float
) -> list[Any]:
    """Add what is known of focal lengths to a Ceres problem with a Cauchy loss.

    Args:
        problem: Ceres problem of a bundle adjustment; cameras that it does not have are passed over.
        reconstruction: pycolmap's, whose parameters the problem adjusts.
        priors: Focal lengths by COLMAP's numbers of the cameras.
        scale: Typical miss of an observation, px, against which the priors are weighed.

    Returns:
        What has to live until the problem is solved: the problem does not own it.
    """
    added = []
    for number, prior in sorted(priors.items()):
        camera = reconstruction.cameras[number]
        parameters = camera.params
        if not problem.has_parameter_block(parameters):
            continue
        spread = prior.spread / HOLDS if prior.held else prior.spread
        covariance = np.eye(len(parameters)) * _OPEN**2
        mean = np.array(parameters, np.float64)
        focal = list(camera.focal_length_idxs())
        variance, apart = spread**2, (_ASPECT * prior.px) ** 2
        covariance[np.ix_(focal, focal)] = variance
        if len(focal) == 2:
            covariance[np.ix_(focal, focal)] += apart * np.array([[1.0, -1.0], [-1.0, 1.0]])
        mean[focal] = prior.px
        cost = pyceres.factors.NormalPrior(mean, covariance / (SHARE * scale**2))
        problem.add_residual_block(cost, None, [parameters])
        added.append(cost)
    return added

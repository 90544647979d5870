"""Effect of a focal length on the points of a scene, with all else adjusted along.

Flat ground seen straight down looks alike through a long lens from high up and through a short one from low
down. A fit still prefers one of them, by thousandths of a pixel: far less than what no model of a lens knows
of it, a shutter that rolls while the camera moves or a lens that breathes. How many points say so is of no
matter then, since all of them err together.
"""

from typing import Any

import numpy as np

from calib.adjustment.bundle_adjustment import Free
from calib.adjustment.jacobian import linearise
from calib.adjustment.reduced_curvature import built_terms, reduced

CHANGE = 0.1
"""Relative change of the focal length whose effect is measured."""
DETERMINED = 4e-5
"""Share of an image's width by which points have to move with that change for the scene to determine the
focal length. Flights over flat ground move them by 6e-6, flights over houses by 5e-5, walks by 1e-4 and more,
rings by 7e-4 (bench.calibration.tracks); a real flight over a park by 7e-6, photographs of fruit, of a castle
and of six buildings by 1.1e-4 to 2.9e-4. Five views of a walk past a wall that turned about the vertical only
move them by 3.1e-5, and led to 329 x 490 px for 260; eighteen of a path-traced room by 6.9e-5, and to one
that is right to 0.5 %.
"""
_RIDGE = 1e-9


def effect(reconstruction: Any, free: Free, scale: float) -> dict[int, float]:
    """Movement of a camera's points with a focal length that is CHANGE longer, px rms, by COLMAP's number of
    the camera.

    Poses, points and the other terms of the lenses make up for as much of it as they can. Nothing but points
    counts for the focal length. Cameras whose lens is fixed have no entry. scale: of the Cauchy loss, px.
    """
    linear = linearise(reconstruction, free)
    if not linear.lenses:
        return {}
    part = reduced(linear, scale)
    curvature = part.curvature
    columns, errors, _ = built_terms(linear, reconstruction, free)
    of_focal = np.isin(columns, list(linear.lenses.values()))
    columns, errors = columns[~of_focal], errors[~of_focal]
    curvature[columns, columns] += part.variance / errors**2
    size = np.sqrt(np.diag(curvature))
    size[size == 0] = 1.0
    curvature = curvature / size / size[:, None] + _RIDGE * np.eye(len(size))
    places = list(linear.lenses.values())
    unit = np.zeros((len(size), len(places)))
    unit[places, np.arange(len(places))] = 1.0
    covariance = np.linalg.solve(curvature, unit)[places, np.arange(len(places))] / size[places] ** 2
    camera = np.array([reconstruction.image(int(image)).camera_id for image in linear.image])
    weights = np.array([part.weight[camera == number].sum() for number in linear.lenses])
    moved = CHANGE / np.sqrt(np.maximum(covariance, 1e-30) * weights)
    return {
        number: float(moved[row] * reconstruction.cameras[number].mean_focal_length())
        for row, number in enumerate(linear.lenses)
    }

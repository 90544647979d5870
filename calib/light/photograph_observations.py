"""Colours of scene points in photographs, and the factor of each photograph that evens them out."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from calib.light.falloff import DARKEST, light_left
from calib.light.tracks import point_observations
from calib.light.vignetting import Falloff
from calib.poses.sfm import SceneModel
from imaging.arrays import Array, Integers, Mask
from imaging.robust import huber_weight, robust_scale
from imaging.session.view_id import ViewId

ROUNDS = 10
HUBER = 1.5


@dataclass(frozen=True, eq=False)
class PhotographObservations:
    """Colours of scene points in photographs; rows are observations.

    point, view: int [N]; colour: float64 [N, 3], natural log of linear light, falloff and gain divided out;
    direction: float64 [N, 3], unit, from the point to the camera; region: int [N], of the scene.
    """

    point: Integers
    view: Integers
    colour: Array
    direction: Array
    region: Integers

    def part(self, keep: Mask) -> "PhotographObservations":
        """The observations that `keep` [N] names."""
        return PhotographObservations(
            self.point[keep], self.view[keep], self.colour[keep], self.direction[keep], self.region[keep]
        )


def photograph_observations(
    model: SceneModel, colours: Mapping[ViewId, Array], photographs: Collection[str], falloff: Falloff | None
) -> tuple[PhotographObservations, list[ViewId]]:
    """Return the light of shared points in some cameras' photographs, and their views.

    Args:
        model: Placed views and their scene points.
        colours: Natural log of camera RGB at each feature of each view [K, 3], as `colour_at` gives it.
        photographs: Names of the cameras whose views count.
        falloff: Vignetting and gains to be divided out; None if still unknown.

    Returns:
        The observations, and the views in the order of `PhotographObservations.view`.
    """
    usable: dict[ViewId, Mask] = {}
    for view, colour in colours.items():
        usable[view] = np.isfinite(colour).all(axis=1) & np.full(len(colour), view.camera in photographs)
    observations = point_observations(model, usable)
    light = observations.values(colours)
    if falloff is not None:
        names = [view.camera for view in observations.views]
        terms = np.array([falloff.vignetting[name] for name in names])[observations.view]
        fall = light_left(terms, observations.radius)
        gain = np.array([falloff.gain[name] for name in names])[observations.view]
        light -= np.log(np.maximum(fall, DARKEST) * gain)[:, None]
    return PhotographObservations(
        observations.point, observations.view, light, observations.direction, observations.region
    ), observations.views


def shared(observations: PhotographObservations) -> PhotographObservations:
    """The points that two photographs see or more."""
    _, point, counts = np.unique(observations.point, return_inverse=True, return_counts=True)
    return observations.part(counts[point] >= 2)


def solved(observations: PhotographObservations, count: int) -> Array:
    """ln d [count, 3], zero in the mean over the photographs of every channel."""
    _, point = np.unique(observations.point, return_inverse=True)
    points = int(point.max()) + 1
    logs = np.zeros((count, 3))
    for channel in range(3):
        value = observations.colour[:, channel]
        weight = np.ones(len(value))
        for _ in range(ROUNDS):
            cross = sparse.coo_matrix((weight, (point, observations.view)), (points, count)).tocsr()
            total = np.bincount(point, weight, points)
            share = sparse.diags(1 / np.maximum(total, 1e-12)) @ cross
            diagonal = np.bincount(observations.view, weight, count)
            normal = np.diag(diagonal) - (cross.T @ share).toarray()
            right = np.bincount(observations.view, weight * value, count)
            right -= share.T @ np.bincount(point, weight * value, points)
            # A photograph that shares no point, and the gauge of all, are left at zero.
            logs[:, channel] = np.linalg.pinv(normal, rcond=1e-9, hermitian=True) @ right
            left = value - logs[observations.view, channel]
            left -= (np.bincount(point, weight * left, points) / np.maximum(total, 1e-12))[point]
            weight = huber_weight(left, HUBER * max(robust_scale(left), 1e-6))
    observed = np.bincount(observations.view, minlength=count) > 0
    logs[observed] -= logs[observed].mean(axis=0)
    return logs


def residual_of(observations: PhotographObservations, logs: Array) -> Array:
    """Return what is left between the photographs of each point, [N, 3]."""
    _, point = np.unique(observations.point, return_inverse=True)
    residual = observations.colour - logs[observations.view]
    middle = (
        np.stack([np.bincount(point, column) for column in residual.T], axis=1) / np.bincount(point)[:, None]
    )
    return np.asarray(residual - middle[point])

"""Marked points in the coordinates of the scene, by the views that show them."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from imaging.arrays import Array
from imaging.files.colmap import pycolmap
from imaging.session.view_id import ViewId

MISSED = 4.0
"""px of the picture by which a mark may miss where the others put the point."""
_STEPS = 10
_SLIGHT = 1e-5
"""Displacement of a point, as a share of the distance, for numerical derivatives of its projection."""


@dataclass(frozen=True, eq=False)
class Sighting:
    """A point in the scene.

    spread: [3, 3], its covariance where marks err by 1 px of the picture. misses: of each view that was used
    from its mark to the projection, px of the picture. odd: views whose marks the others contradict.
    """

    place: Array
    spread: Array
    misses: dict[ViewId, Array]
    odd: tuple[ViewId, ...]


class Views:
    """The views of a model, which project points; px are those of its pictures."""

    def __init__(self, reconstruction: Any) -> None:
        self._motions: dict[ViewId, Any] = {}
        self._cameras: dict[ViewId, Any] = {}
        for index in sorted(reconstruction.reg_image_ids()):
            image = reconstruction.image(index)
            view = ViewId.of_image(image.name)
            self._motions[view] = image.cam_from_world()
            self._cameras[view] = reconstruction.cameras[image.camera_id]

    def __contains__(self, view: object) -> bool:
        return view in self._motions

    def project(self, view: ViewId, points: Array) -> Array:
        """Points [K, 3] in a view, px [K, 2]; NaN behind the camera."""
        motion = self._motions[view].matrix()
        in_camera = points @ motion[:, :3].T + motion[:, 3]
        pixels = np.full((len(points), 2), np.nan)
        front = in_camera[:, 2] > 1e-9
        if front.any():
            pixels[front] = self._cameras[view].img_from_cam(in_camera[front])
        return pixels

    def place(self, marks: Mapping[ViewId, Array]) -> Sighting | None:
        """The point that views show at these places, px; None where fewer than two of them agree on one."""
        views = [view for view in marks if view in self._motions]
        if len(views) < 2:
            return None
        options = pycolmap.EstimateTriangulationOptions()
        options.residual_type = pycolmap.TriangulationResidualType.REPROJECTION_ERROR
        options.ransac.max_error = MISSED
        options.ransac.random_seed = 0
        triangulated = pycolmap.estimate_triangulation(
            np.array([marks[view] for view in views]),
            [self._motions[view] for view in views],
            [self._cameras[view] for view in views],
            options,
        )
        if triangulated is None:
            return None
        agree = [view for view, fits in zip(views, np.ravel(triangulated["inliers"]), strict=True) if fits]
        if len(agree) < 2:
            return None
        place, spread, misses = self._refined(
            np.asarray(triangulated["xyz"], np.float64).ravel(), agree, marks
        )
        if not np.isfinite(spread).all() or not np.isfinite(misses).all():
            return None
        odd = tuple(view for view in views if view not in agree)
        return Sighting(place, spread, dict(zip(agree, misses, strict=True)), odd)

    def _refined(
        self, place: Array, views: list[ViewId], marks: Mapping[ViewId, Array]
    ) -> tuple[Array, Array, Array]:
        """The point with the least squares of misses, its covariance for 1 px, and the misses [K, 2]."""
        marked = np.stack([marks[view] for view in views])
        slope = np.zeros((2 * len(views), 3))
        for _ in range(_STEPS):
            step = _SLIGHT * max(self._distance(view, place) for view in views)
            around = place + step * np.vstack([np.zeros(3), np.eye(3), -np.eye(3)])
            projected = np.stack([self.project(view, around) for view in views])  # [K, 7, 2]
            slope = ((projected[:, 1:4] - projected[:, 4:]) / (2 * step)).transpose(0, 2, 1).reshape(-1, 3)
            miss = (projected[:, 0] - marked).ravel()
            if not np.isfinite(slope).all() or not np.isfinite(miss).all():
                break
            place = place - np.linalg.lstsq(slope, miss, rcond=None)[0]
        misses = np.concatenate([self.project(view, place[None]) for view in views]) - marked
        with np.errstate(all="ignore"):
            spread = np.linalg.pinv(slope.T @ slope) if np.isfinite(slope).all() else np.full((3, 3), np.nan)
        return place, np.asarray(spread, np.float64), misses

    def _distance(self, view: ViewId, place: Array) -> float:
        motion = self._motions[view].matrix()
        return float(np.linalg.norm(motion[:, :3] @ place + motion[:, 3]))


def mark_error(sightings: Mapping[str, Sighting]) -> float:
    """Standard error of a coordinate of a mark, px of the picture, by how marks of one point disagree."""
    squares = sum(float((miss**2).sum()) for one in sightings.values() for miss in one.misses.values())
    free = sum(2 * len(one.misses) - 3 for one in sightings.values())
    return float(np.sqrt(squares / free)) if free > 0 else 1.0

"""Sub-pixel refinement of scene points: their patches, aligned between views.

SIFT places each feature by itself, and otherwise when a surface is seen at another slant. A patch that is
warped until it looks like the patch around the point in another view measures the place anew (Lucas and
Kanade 1981, in the inverse form of Baker and Matthews, "Lucas-Kanade 20 Years On", 2004; what it buys poses:
Lindenberger et al., "Pixel-Perfect Structure-from-Motion", 2021).
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from scipy import ndimage

from calib.adjustment.observations import observations
from imaging.arrays import Array, Array32, Integers
from imaging.compute.threads import in_turn
from imaging.progress import Progress
from imaging.session.view_id import ViewId

RADIUS = 7
"""Half width of a patch, px."""
ITERATIONS = 12
STILL = 0.003
"""A step so short, px, ends the search."""
FARTHEST = 1.5
"""A patch that wanders farther from its feature, px, shows something else."""
LEAST_LIKENESS = 0.8
"""Correlation of patches that show the same."""
_DAMPING = 1e-4
_ACROSS = np.arange(-RADIUS, RADIUS + 1.0)
_GRID = np.stack(np.meshgrid(_ACROSS, _ACROSS), axis=-1).reshape(-1, 2)
_WEIGHT = np.exp(-0.5 * (_GRID**2).sum(1) / (RADIUS / 1.7) ** 2)
_WEIGHT /= _WEIGHT.sum()


@dataclass(frozen=True, eq=False)
class _Observations:
    """Observations, in order of points: image and feature, by COLMAP's numbers, point by order, int64 [N];
    place: px [N, 2]; world: the point [N, 3]."""

    image: Integers
    feature: Integers
    point: Integers
    place: Array
    world: Array


def refine_points(reconstruction: Any, pictures: Mapping[ViewId, bytes], progress: Progress) -> None:
    """Put the observations of a COLMAP model, whose poses are nearly right, to where their patches match.

    pictures: of views, as 8-bit grey PNGs, by whose pixels the model counts; other views stay as they are, as
    does one of each track: the one that looks from the middle of all. Those unlike it are dropped.
    """
    observations = _gather(reconstruction, pictures)
    if not len(observations.image):
        return
    slopes, middle = _slopes(reconstruction, observations)
    reference = _references(observations, middle)[observations.point]
    with np.errstate(all="ignore"):
        warps = slopes @ np.linalg.pinv(slopes[reference])
    usable = np.isfinite(warps).all((1, 2)) & (np.abs(np.linalg.det(warps)) > 0.1)
    images = np.unique(observations.image)
    names = {image: ViewId.of_image(reconstruction.image(int(image)).name) for image in images}
    templates = np.zeros((int(observations.point.max()) + 1, len(_GRID)), np.float32)
    for image in images:
        rows = np.unique(reference[observations.image[reference] == image])
        picture = _decoded(pictures[names[image]])
        still = np.broadcast_to(np.eye(2), (len(rows), 2, 2))
        templates[observations.point[rows]] = _unit(_sample(picture, still, observations.place[rows]))

    def matched(number: int) -> tuple[Integers, Array, Array]:
        """The observations of an image, where they belong, and how much that looks like their points."""
        image = images[number]
        rows = np.flatnonzero(
            (observations.image == image) & usable & (reference != np.arange(len(reference)))
        )
        picture = _decoded(pictures[names[image]])
        return rows, *_search(
            picture, templates[observations.point[rows]], warps[rows], observations.place[rows]
        )

    for done, (rows, places, likeness) in enumerate(in_turn(len(images), matched)):
        progress("aligning patches", done, len(images))
        image = int(images[done])
        view = reconstruction.image(image)
        moved = np.linalg.norm(places - observations.place[rows], axis=1)
        good = (likeness > LEAST_LIKENESS) & (moved < FARTHEST)
        for feature, place, accepted in zip(
            observations.feature[rows].tolist(), places, good.tolist(), strict=True
        ):
            if accepted:
                view.point2D(feature).xy = place
            elif view.point2D(feature).has_point3D():  # a point that lost all but one went with the last
                reconstruction.delete_observation(image, feature)
    progress("aligning patches", len(images), len(images))


def _gather(reconstruction: Any, pictures: Collection[ViewId]) -> _Observations:
    every = observations(reconstruction)
    shown = [index for index in reconstruction.reg_image_ids()
             if ViewId.of_image(reconstruction.image(index).name) in pictures]  # fmt: skip
    rows = np.lexsort([every.feature, every.image, every.point])
    rows = rows[np.isin(every.image[rows], shown)]
    point = np.unique(every.point[rows], return_inverse=True)[1]
    return _Observations(
        every.image[rows], every.feature[rows], point, every.observed[rows], every.world[every.point[rows]]
    )


def _slopes(reconstruction: Any, observations: _Observations) -> tuple[Array, Array]:
    """Derivatives of pixels by a point on a plane that faces its cameras, [N, 2, 2]; and the cosine between
    each camera's direction and the mean of all that see the point, [N].
    """
    toward = np.empty_like(observations.world)
    motions = {}
    for image in np.unique(observations.image):
        motion = reconstruction.image(int(image)).cam_from_world().matrix()
        motions[image] = motion
        in_image = observations.image == image
        toward[in_image] = -motion[:, :3].T @ motion[:, 3] - observations.world[in_image]
    distance = np.linalg.norm(toward, axis=1, keepdims=True)
    toward /= distance
    normal = np.zeros((int(observations.point.max()) + 1, 3))
    np.add.at(normal, observations.point, toward)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True) + 1e-12
    facing = normal[observations.point]
    axis = np.where(np.abs(facing[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    across = np.cross(facing, axis)
    across /= np.linalg.norm(across, axis=1, keepdims=True) + 1e-12
    sides = (across, np.cross(facing, across))
    slopes = np.empty((len(observations.image), 2, 2))
    for image, motion in motions.items():
        in_image = observations.image == image
        camera = reconstruction.cameras[reconstruction.image(int(image)).camera_id]
        step = 1e-4 * float(np.median(distance[in_image]))
        for column, side in enumerate(sides):
            ends = [
                camera.img_from_cam(
                    (observations.world[in_image] + way * side[in_image]) @ motion[:, :3].T + motion[:, 3]
                )
                for way in (step, -step)
            ]
            slopes[in_image, :, column] = (ends[0] - ends[1]) / (2 * step)
    return slopes, (toward * facing).sum(1)


def _references(observations: _Observations, middle: Array) -> Integers:
    """Reference observation of each point, with which all others are compared."""
    order = np.lexsort((-middle, observations.point))
    first = np.concatenate([[True], np.diff(observations.point[order]) > 0])
    return np.asarray(order[first], np.int64)


def _decoded(png: bytes) -> Array32:
    """A picture as coefficients of a cubic spline."""
    picture = np.asarray(cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_GRAYSCALE), np.float32)
    return np.asarray(ndimage.spline_filter(picture, 3, np.float32, "mirror"))


def _sample(picture: Array32, warps: Array, places: Array) -> Array32:
    """Patches [N, P] around places [N, 2], px, the grid turned and stretched by warps [N, 2, 2]."""
    at = np.einsum("nij,pj->inp", warps, _GRID) + places.T[:, :, None] - 0.5
    return np.asarray(ndimage.map_coordinates(picture, at[::-1], np.float32, 3, "mirror", prefilter=False))


def _unit(patches: Array32) -> Array32:
    """Patches of mean 0 and length 1, so that brightness and contrast do not matter; flat ones are 0."""
    less = patches - (patches @ _WEIGHT.astype(np.float32))[:, None]
    length = np.sqrt((less**2) @ _WEIGHT.astype(np.float32))
    return np.asarray(less / (length + np.float32(0.01))[:, None])


def _search(picture: Array32, templates: Array32, warps: Array, places: Array) -> tuple[Array, Array]:
    """Places [N, 2] in a picture where patches look like templates [N, P], and how much they do, [N]."""
    steps = _steps(templates)
    warps, places, likeness = warps.copy(), places.copy(), np.zeros(len(places))
    remaining = np.arange(len(places))
    for _ in range(ITERATIONS):
        if not len(remaining):
            break
        patches = _unit(_sample(picture, warps[remaining], places[remaining]))
        likeness[remaining] = (patches * templates[remaining]) @ _WEIGHT
        apart = patches / np.maximum(likeness[remaining], 0.3)[:, None] - templates[remaining]
        step = np.einsum("nap,np->na", steps[remaining], apart)
        shift, bend = np.clip(step[:, :2], -1, 1), np.clip(step[:, 2:].reshape(-1, 2, 2), -0.1, 0.1)
        # The step was found as if the template had moved: the warp takes it the other way.
        warps[remaining] = warps[remaining] @ np.linalg.inv(np.eye(2) + bend)
        places[remaining] -= np.einsum("nij,nj->ni", warps[remaining], shift)
        remaining = remaining[np.linalg.norm(shift, axis=1) > STILL]
    return places, likeness


def _steps(templates: Array32) -> Array32:
    """Gauss-Newton matrices of the templates, from differences [P] to shift and bend of the warp, [N, 6,
    P].
    """
    side = len(_ACROSS)
    down, across = (slope.reshape(-1, side * side) for slope in
                    np.gradient(templates.reshape(-1, side, side), axis=(1, 2)))  # fmt: skip
    x, y = _GRID.T.astype(np.float32)
    slopes = np.stack([across, down, across * x, across * y, down * x, down * y], axis=1)
    weight = _WEIGHT.astype(np.float32)
    slopes -= (slopes @ weight)[:, :, None]  # brightness
    slopes -= np.einsum("nap,np->na", slopes, weight * templates)[:, :, None] * templates[:, None]  # contrast
    normal = np.einsum("nap,nbp->nab", slopes * weight, slopes, optimize=True).astype(np.float64)
    normal += _DAMPING * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(6)
    normal += 1e-12 * np.eye(6)
    return np.asarray(np.linalg.inv(normal) @ (slopes * weight).astype(np.float64), np.float32)

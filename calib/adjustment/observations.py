"""Observations of a COLMAP model's points, as arrays."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from imaging.arrays import Array, Integers


@dataclass(frozen=True, eq=False)
class Observations:
    """Arrays of N observations of M points, in order of images and features.

    image, feature: COLMAP's numbers [N]; point: row [N] of `world`; seen: px [N, 2]; numbers: COLMAP's, of
    each point [M], ascending; world: the points [M, 3].
    """

    image: Integers
    feature: Integers
    point: Integers
    observed: Array
    numbers: Integers
    world: Array

    def of_images(self) -> list[tuple[int, slice]]:
        """Every image that sees a point, and its rows."""
        images, starts = np.unique(self.image, return_index=True)
        bounds = [*starts.tolist(), len(self.image)]
        return [
            (int(image), slice(start, end))
            for image, start, end in zip(images, bounds, bounds[1:], strict=False)
        ]


def observations(reconstruction: Any) -> Observations:
    """All of them, of the images that have a pose."""
    world = {number: point.xyz for number, point in reconstruction.points3D.items()}
    numbers = np.array(sorted(world), np.int64)
    image, feature, owner, places = [], [], [], []
    for index in sorted(reconstruction.reg_image_ids()):
        view = reconstruction.image(index)
        # Asked of the image as a whole: a look at each of its features takes many times as long.
        points_of_view = view.get_observation_points2D()
        image.append(np.full(len(points_of_view), index, np.int64))
        feature.append(np.array(view.get_observation_point2D_idxs(), np.int64))
        owner.append(np.array([point.point3D_id for point in points_of_view], np.int64))
        places.append(np.array([point.xy for point in points_of_view], np.float64).reshape(-1, 2))
    nothing = np.zeros(0, np.int64)
    return Observations(
        np.concatenate([nothing, *image]),
        np.concatenate([nothing, *feature]),
        np.searchsorted(numbers, np.concatenate([nothing, *owner])),
        np.concatenate([np.zeros((0, 2)), *places]),
        numbers,
        np.array([world[number] for number in numbers.tolist()], np.float64).reshape(-1, 3),
    )

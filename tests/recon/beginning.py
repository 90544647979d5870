"""The beginning of a small training, always the same."""

from collections.abc import Callable

import numpy as np

from recon.data.dataset import Dataset
from recon.data.light import light_of, radiance_image
from recon.methods import METHODS
from recon.start.initialisation import gaussians_at, start_points
from recon.train.training import Training


def beginning(dataset: Dataset, count: int, seed: int = 0) -> Callable[..., Training]:
    """A function that makes a new training of a method from the same `count` points."""
    images = [radiance_image(view) for view in dataset.train]
    light = light_of(dataset, images)
    points = start_points(dataset, images, count, np.random.Generator(np.random.PCG64(seed)))

    def begin(name: str = "nh-3dgs", **options: object) -> Training:
        method = METHODS[name](dataset, light)
        gaussians = gaussians_at(points, method.appearance, method.observation.units)
        return Training.begin(method, light, gaussians, dataset.extent, **options)

    return begin

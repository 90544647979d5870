"""Evidence of a session that a training is decided by, and the run that asks for it."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
import torch

from imaging.progress import Progress
from recon.data.dataset import MOST_TRACKED, Dataset
from recon.data.light import Images, Light, light_of, radiance_images
from recon.data.measured_depth import DepthFit, fit
from recon.decide.cost.countdown import Countdown
from recon.decide.settings import Settings
from recon.start.initialisation import points_of_poses
from recon.train.devices.ranks import Ranks

AS_STATED = 0.05
"""Largest error of ln depth of a scale from swept points (toy scenes of six views: 0.01)."""


@dataclass(frozen=True)
class Run:
    """Running reconstruction: its subject and its environment.

    asked: the requested settings, the method among them. countdown: of a budget of time. say: callback for
    messages on skipped steps and predictions. smaller: the smaller training if the time is too short for this
    one, or None.
    """

    dataset: Dataset
    asked: Settings
    device: torch.device
    ranks: Ranks
    countdown: Countdown | None
    progress: Progress
    say: Callable[[str], None]
    clock: Callable[[], float]
    smaller: Settings | None = field(default=None, kw_only=True)

    def seconds_left(self) -> float | None:
        """Seconds until training has to be over; None without a time limit."""
        return None if self.countdown is None else self.countdown.remaining()


@dataclass(frozen=True)
class Evidence:
    """Views of a session as they are looked at before a training.

    dataset: with its depth maps, if they fit, in scene coordinates. images: the radiance images of the
    training views; look: seconds that they took. depths: the fit of the maps, or None without maps.
    """

    dataset: Dataset
    images: Images
    light: Light
    look: float
    depths: DepthFit | None = None

    @classmethod
    def of(cls, run: Run) -> Self:
        """Read the training views for the first time."""
        began = run.clock()
        images = radiance_images(run.dataset, run.progress)
        light, depths = light_of(run.dataset, images), depth_fit(run.dataset, images, run.progress)
        used = depths is not None and depths.fits and run.asked.overrides.depth != 0
        dataset = run.dataset.with_depths(depths.scale if depths is not None and used else None)
        return cls(dataset, images, light, run.clock() - began, depths)


def depth_fit(dataset: Dataset, images: Images, progress: Progress) -> DepthFit | None:
    """Return the agreement of the training views' depth maps with the scene points; None without maps.

    Where poses came without points, with those that a sweep of the images finds; a unit that agrees with its
    statement within their error is kept.
    """
    if all(view.depth is None for view in dataset.train):
        return None
    xyz, tracks = dataset.tracks(MOST_TRACKED)
    if len(xyz):
        return fit(dataset.train, xyz, tracks)
    swept = fit(dataset.train, points_of_poses(dataset.with_depths(None), images, progress), {})
    return replace(swept, scale=1.0) if swept and abs(np.log(swept.scale)) < AS_STATED else swept

"""Short trainings on a part of the training views, judged on the others: the evidence of a choice.

The session's own held-out views are never used.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import torch

from imaging.progress import Progress
from imaging.session.view_id import ViewId
from recon.data.dataset import Dataset, View
from recon.data.holdout import held_out
from recon.data.light import Images, Light, light_of, radiance_images
from recon.decide.overrides import Overrides
from recon.decide.settings import Settings
from recon.methods import METHODS
from recon.observe.refinement import Refined, Refinement
from recon.start.far_light import far_light, without_far
from recon.start.initialisation import Start, gaussians_at, start_points
from recon.train.densification import DensityRules
from recon.train.devices.training_device import CPU
from recon.train.monitor import Hooks
from recon.train.schedule import rate_factor
from recon.train.trainer import train
from recon.train.training import Plan, Training

FEWEST_VIEWS = 4
"""Held out of a trial; with fewer a gain cannot be distinguished from luck."""
HELD_OUT = 4
"""Stride of the training views held out of a trial; those of the session are left for the end."""
SAMPLES = 2
"""Samples of the training views, over all colours of a pixel, for a Gaussian: with fewer it learns noise."""


def reason_against_trials(dataset: Dataset, settings: Settings) -> str | None:
    """Return the reason against trials, whatever the time, or None."""
    decided_apart = dict.fromkeys(("refine", "environment", "depth", "overrule"))
    if settings.overrides.model_copy(update=decided_apart) != Overrides():
        return "not tried, since settings were fixed by hand"
    if settings.quality == "draft":
        return "not tried, since a draft is no longer than a trial"
    if too_few_views(dataset):
        count = len(dataset.train)
        return f"not tried, since {count} training views are too few to hold {FEWEST_VIEWS} of them out"
    return None


def too_few_views(dataset: Dataset) -> bool:
    """Return whether a data set has too few training views for trials."""
    return len(_out(dataset)) < FEWEST_VIEWS


def room(dataset: Dataset) -> int:
    """Maximum number of Gaussians that the training views can resolve.

    A pixel of a mosaic is one sample, any other one three; a bracket counts once.
    """
    samples = sum(
        view.lens.width * view.lens.height * (1 if view.shots[0].pixels.ndim == 2 else 3)
        for view in dataset.train
    )
    return max(1, samples // SAMPLES)


def _out(dataset: Dataset) -> set[ViewId]:
    return held_out((view.id for view in dataset.train), HELD_OUT)


def _parted(dataset: Dataset) -> Dataset:
    """The training views as a data set of their own, of which one view in `HELD_OUT` judges."""
    out = _out(dataset)
    trained = tuple(view for view in dataset.train if view.id not in out)
    judged = tuple(view for view in dataset.train if view.id in out)
    return replace(dataset, train=trained, held_out=judged)


@dataclass
class Steps:
    """Progress over a series of trainings and the fits of views that judge them, in one length, so that the
    time left falls from the first to the last.

    total: iterations and steps of fits, at most, where they are known.
    """

    total: int = 0
    done: int = 0


@dataclass(frozen=True)
class Trials:
    """Common inputs of the trials of one session.

    part: the data set whose held-out views are those that judge a trial, all of them from the training
    views. images: radiance images of those that train. points: where trials start, SfM points first.
    """

    part: Dataset
    light: Light
    images: Images
    points: Start
    settings: Settings
    progress: Progress
    device: torch.device = CPU
    steps: Steps = field(default_factory=Steps)

    @classmethod
    def of(
        cls,
        dataset: Dataset,
        settings: Settings,
        points: Start,
        progress: Progress,
        device: torch.device = CPU,
    ) -> "Trials":
        """Trials of a data set's training views, from given points."""
        part = _parted(dataset)
        images = radiance_images(part, progress)
        return cls(part, light_of(part, images), images, points, settings, progress, device)

    @classmethod
    def from_new_points(
        cls,
        dataset: Dataset,
        settings: Settings,
        count: int,
        progress: Progress,
        device: torch.device = CPU,
    ) -> "Trials":
        """The same from at most `count` points, found in those views that do not judge."""
        part = _parted(dataset)
        images = radiance_images(part, progress)
        rng = np.random.Generator(np.random.PCG64([settings.seed, 0x7121A1]))
        points = start_points(part, images, count, rng, progress)
        return cls(part, light_of(part, images), images, points, settings, progress, device)

    def trained(
        self,
        iterations: int,
        gaussians: int,
        message: str,
        *,
        refine: Sequence[Refined] = (),
        degree: int | None = None,
        points: Start | None = None,
        environment: bool | None = None,
        depth: float | None = None,
    ) -> Training:
        """Train to the end of a short schedule, with at most that many Gaussians.

        degree: of the harmonics; None: the method's own. points: to start from; None: all. environment:
        whether light is behind the Gaussians, depth: the weight of measured depth; None: that of the
        settings.
        """
        method = replace(
            METHODS[self.settings.method](self.part, self.light),
            depth_weight=self.settings.depth if depth is None else depth,
        )
        if degree is not None:
            method = Overrides(degree=degree).composed(method)
        started, far = points or self.points, None
        if self.settings.environment if environment is None else environment:
            units = method.observation.units
            far = far_light(self.part.train, self.images, units)
            started = without_far(started, self.part.train, self.images, far, units)
        start = gaussians_at(started, method.appearance, method.observation.units)
        refinement = Refinement.of(self.part, refine) if refine else None
        training = Training.begin(method, self.light, start, self.part.extent, self.device, refinement, far)
        rules, factor = DensityRules(gaussians), rate_factor(iterations)
        plan = Plan(iterations, rules, self.settings.seed, rate_factor=factor)

        before = self.steps.done

        def reported(_: str, done: int, total: int) -> None:
            self.progress(message, before + done, max(before + total, self.steps.total))

        train(training, self.part, plan, Hooks(progress=reported))
        self.steps.done = before + iterations
        return training

    def fitted(self, steps: int, message: str) -> None:
        """Count steps of fits of views."""
        self.steps.done += steps
        self.progress(message, self.steps.done, max(self.steps.done, self.steps.total))

    @property
    def judged(self) -> tuple[View, ...]:
        """The views that judge."""
        return self.part.held_out

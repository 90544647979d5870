"""Regularisers of a training of few views, each a change of the usual one from outside."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from recon.data.dataset import Dataset
from recon.methods.method import Method
from recon.observe.linear import Observation
from recon.scene.appearance import Appearance, Parameters
from recon.scene.gaussians import Gaussians, Renderer, Shapes
from recon.splat import Render, SplatCamera
from recon.train.adam import Adam
from recon.train.training import Training

NEAR = 0.02
"""Share of a view's starting points that are nearer than its near depth."""


@dataclass(frozen=True)
class Regulariser:
    """One candidate; nothing of it: the usual training.

    drop: share of the Gaussians left out of each render in training, the opacities of the others divided by
    what stays (DropGaussian, Park et al., arXiv 2504.00773). rises: whether that share grows from 0. opacity:
    weight of the mean opacity in the loss. background: brightest code of a random background behind what is
    not opaque. ssim: its weight, if another. means: factor of the rate of the means. ratio: most of the
    largest axis over the second. decay: factor of opacities each tenth iteration, up to 0.9 of the training.
    slow: gradients of Gaussians nearer than this times twice the near depth are scaled by the square of their
    distance (after Philip and Deschaintre 2023). size: weight, in the loss, of the mean largest axis over the
    distance to the nearest training camera.
    """

    drop: float = 0.0
    rises: bool = False
    opacity: float = 0.0
    background: float = 0.0
    ssim: float | None = None
    means: float = 1.0
    ratio: float = math.inf
    decay: float = 1.0
    slow: float = 0.0
    size: float = 0.0

    def method(self, method: Method) -> Method:
        """The method with another loss and rates."""
        rate = method.geometry.means
        means = replace(rate, start=rate.start * self.means, end=rate.end * self.means)
        if self.ssim is not None:
            method = replace(method, loss=replace(method.loss, ssim_weight=self.ssim))
        geometry = replace(method.geometry, means=means)
        return replace(method, geometry=geometry, opacity_weight=self.opacity)


class Regularised(Training):
    """A training under a regulariser, which `bind` sets."""

    def bind(self, regulariser: Regulariser, dataset: Dataset, iterations: int, seed: int) -> None:
        """Let a regulariser change renders, comparisons and steps from here on."""
        self.drawing = _Renderer(**vars(super().renderer()))
        hold = _Hold(regulariser, self, iterations, torch.Generator().manual_seed(seed + 77))
        object.__setattr__(self.drawing, "hold", hold)
        if regulariser.slow:
            hold.near = regulariser.slow * 2 * _near_depth(dataset, self.gaussians)
        if regulariser.background:
            observation: Any = _Before(self.method.observation, hold)
            self.method = replace(self.method, observation=observation)
        if regulariser.size:
            appearance: Any = _Small(self.method.appearance, dataset, regulariser.size)
            self.method = replace(self.method, appearance=appearance)
        self.optimizer = _Steps(self.optimizer.param_groups, hold)

    def renderer(self) -> Renderer:
        """Return how its Gaussians are drawn while it is trained."""
        return self.drawing


@dataclass
class _Hold:
    """Between a render and its step; `render` and `camera` are the last ones."""

    regulariser: Regulariser
    training: Training
    iterations: int
    generator: torch.Generator
    near: float = 0.0
    render: Render | None = None
    camera: SplatCamera | None = None

    @property
    def done(self) -> float:
        return self.training.iteration / self.iterations


class _Renderer(Renderer):
    hold: _Hold

    def __call__(self, gaussians: Gaussians, camera: SplatCamera, **options: Any) -> Render:
        self.hold.camera = camera
        self.hold.render = super().__call__(gaussians, camera, **options)
        return self.hold.render

    def _shapes(self, gaussians: Gaussians, camera: SplatCamera, away: Tensor) -> Shapes:
        shapes, hold = super()._shapes(gaussians, camera, away), self.hold
        share = hold.regulariser.drop * (hold.done if hold.regulariser.rises else 1.0)
        if not hold.regulariser.drop:
            return shapes
        stays = torch.rand(len(gaussians), generator=hold.generator) >= share
        opacities = (shapes.opacities * (1 / (1 - share))).clamp_max(1.0)
        return shapes._replace(opacities=torch.where(stays, opacities, 0.0))


class _Before:
    """An observation before a random background."""

    def __init__(self, observation: Observation, hold: _Hold) -> None:
        self.observation, self.hold = observation, hold

    def __getattr__(self, name: str) -> Any:
        return getattr(self.observation, name)

    def compare(self, *arguments: Any) -> tuple[Tensor, Tensor]:
        prediction, target = self.observation.compare(*arguments)
        assert self.hold.render is not None
        drawn = torch.rand((len(target), 1, 1), generator=self.hold.generator)
        code = (drawn < 0.5).float() * self.hold.regulariser.background
        return prediction + (1 - self.hold.render.alpha)[None] * code, target


class _Small:
    """An appearance whose penalty pulls at the size of Gaussians, too."""

    def __init__(self, appearance: Appearance, dataset: Dataset, weight: float) -> None:
        self.appearance, self.weight = appearance, weight
        self.centres = torch.tensor(np.array([view.centre for view in dataset.train]), dtype=torch.float32)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.appearance, name)

    def penalty(self, parameters: Parameters) -> Tensor:
        distance = torch.cdist(parameters["means"].detach(), self.centres).amin(1).clamp_min(1e-6)
        size = (parameters["log_scales"].exp().amax(1) / distance).mean()
        return self.appearance.penalty(parameters) + self.weight * size


class _Steps(Adam):
    def __init__(self, groups: list[dict[str, Any]], hold: _Hold) -> None:
        super().__init__(groups, eps=1e-15)
        self.hold = hold

    @torch.no_grad()
    def step(self, *arguments: Any, **options: Any) -> Any:
        rule, hold = self.hold.regulariser, self.hold
        parameters, camera = hold.training.gaussians.parameters, hold.camera
        if rule.slow and camera is not None:
            motion = camera.cam_from_world
            centre = torch.from_numpy((-motion[:3, :3].T @ motion[:3, 3]).astype(np.float32))
            factor = ((parameters["means"] - centre).norm(dim=1) / hold.near).square().clamp_max(1)
            for value in parameters.values():
                if value.grad is not None:
                    value.grad *= factor.reshape(-1, *[1] * (value.ndim - 1))
        result = super().step(*arguments, **options)
        number = hold.training.iteration + 1
        if number % 5 == 0 and rule.ratio < math.inf:
            logs = parameters["log_scales"]
            logs.copy_(torch.minimum(logs, logs.sort(1).values[:, 1:2] + math.log(rule.ratio)))
        if number % 10 == 0 and rule.decay < 1 and hold.done < 0.9:
            opacities = torch.sigmoid(parameters["opacity_logits"]) * rule.decay
            parameters["opacity_logits"].copy_(torch.logit(opacities.clamp(1e-6, 1 - 1e-6)))
        return result


def _near_depth(dataset: Dataset, gaussians: Gaussians) -> float:
    """Median over training views of the depth that only `NEAR` of the Gaussians before them fall short of."""
    depths = []
    for view in dataset.train:
        motion = torch.tensor(view.lens.cam_from_world, dtype=torch.float32)
        place = gaussians.parameters["means"].detach() @ motion[:3, :3].T + motion[:3, 3]
        depth = place[:, 2]
        shown = (depth > 0) & ((place[:, :2] / depth[:, None]).abs().amax(1) < 0.6)
        depths.append(float(depth[shown].quantile(NEAR)) if shown.any() else 0.0)
    return float(torch.tensor(depths).double().quantile(0.5))

"""Growth and pruning as others have them, beside those of `recon`: 3DGS-MCMC's and RadSplat's."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any
from unittest import mock

import torch
from torch import Tensor

from recon.scene.gaussians import Gaussians
from recon.splat import SplatStats
from recon.train.densification import Change, Density, rotate
from recon.train.training import Training

DEAD = 0.005
"""Opacity below which a Gaussian is moved to where one lives."""
SHARE = 0.05
"""Share of the Gaussians that are added at a time."""
NOISE = 5e5
"""Noise of the positions, times their learning rate, as in the authors' code."""


FAINT, FROM = 0.01, 0.5
"""A Gaussian that adds no more than this to any ray is pruned, from that share of the training on."""


@dataclass(frozen=True)
class Contribution(Density):
    """Density control that removes small contributions to every ray from half of the training on, and adds
    nothing.

    RadSplat (Niemeyer et al., arXiv 2403.13806): the largest transmittance times opacity over the rays of an
    epoch; what is brighter than the scene's median is asked for proportionally less, or tails would go.
    """

    def adapt(
        self,
        gaussians: Gaussians,
        luminance: Tensor,
        stats: SplatStats,
        progress: float,
        generator: torch.Generator,
    ) -> Change:
        """Adapt as before, until half of the training."""
        if progress < FROM:
            return super().adapt(gaussians, luminance, stats, progress, generator)
        share = (luminance.median() / luminance.clamp_min(1e-30)).clamp_max(1.0)
        return Change(stats.weight >= FAINT * share, {})


@dataclass(frozen=True)
class Mcmc(Density):
    """Density control of 3DGS-MCMC (Kheradmand et al., arXiv 2404.09591).

    Dead Gaussians are moved to living ones, drawn by opacity; new ones likewise, until the cap is met.
    """

    def adapt(
        self,
        gaussians: Gaussians,
        luminance: Tensor,
        stats: SplatStats,
        progress: float,
        generator: torch.Generator,
    ) -> Change:
        """Relocate Gaussians: opacities and sizes shared so that the picture stays (eq. 9)."""
        opacity = gaussians.opacities().detach()
        broken = ~torch.isfinite(gaussians.parameters["means"].detach()).all(1)
        dead = (opacity < DEAD) | broken
        alive = torch.nonzero(~dead)[:, 0]
        count = int(dead.sum()) + min(self.rules.cap - len(opacity), math.ceil(SHARE * len(opacity)))
        if count <= 0 or not len(alive):
            return Change(~dead, {})
        drawn = alive[torch.multinomial(opacity[alive], count, replacement=True, generator=generator)]
        sources, copies = torch.unique(drawn, return_counts=True)
        keep = ~dead
        keep[sources] = False
        parts = []
        for source, number in zip(sources.tolist(), (copies + 1).tolist(), strict=True):
            parts.append(torch.full((number,), source))
        rows = torch.cat(parts)
        number = torch.repeat_interleave(copies + 1, copies + 1)
        new = gaussians.rows(rows)
        old = torch.sigmoid(new["opacity_logits"]).double()
        each = 1 - (1 - old) ** (1 / number)
        total = torch.zeros_like(old)
        for i in range(1, int(number.max()) + 1):
            for k in range(i):
                term = math.comb(i - 1, k) * (-1) ** k / math.sqrt(k + 1) * each ** (k + 1)
                total = total + torch.where(number >= i, term, 0.0)
        new["opacity_logits"] = torch.logit(each.clamp(DEAD, 1 - 1e-6)).float()
        new["log_scales"] = new["log_scales"] + (old / total.clamp_min(1e-9)).log().float()[:, None]
        return Change(keep, new)


def shake(training: Any, generator: torch.Generator) -> None:
    """Noise on the positions, along each Gaussian's own axes, the more the fainter it is."""
    parameters = training.gaussians.parameters
    (rate,) = (group["lr"] for group in training.optimizer.param_groups if group["name"] == "means")
    with torch.no_grad():
        opacity = training.gaussians.opacities()
        faint = torch.sigmoid(-100 * (opacity - DEAD))[:, None]
        scales = training.gaussians.scales()
        push = scales * scales * torch.randn(len(scales), 3, generator=generator)
        parameters["means"] += NOISE * rate * faint * rotate(parameters["quats"], push)


def contribution() -> Any:
    """Trainings within prune by contribution."""
    return mock.patch("recon.train.trainer.Density", Contribution)


@contextmanager
def mcmc() -> Iterator[None]:
    """Trainings within grow by MCMC, with noise on the positions after every iteration."""
    generator = torch.Generator().manual_seed(0)
    begin = Training.begin.__func__  # type: ignore[attr-defined]

    def begun(cls: type, *parts: Any) -> Any:
        training = begin(cls, *parts)
        step = training.optimizer.step

        def stepped() -> None:
            step()
            shake(training, generator)

        training.optimizer.step = stepped
        return training

    with (
        mock.patch.object(Training, "begin", classmethod(begun)),
        mock.patch("recon.train.trainer.Density", Mcmc),
    ):
        yield

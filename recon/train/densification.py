"""Density control: Gaussians are split where the image is wrong, and pruned where they do not show.

Growth is by rank, not by threshold: at each adaptation the Gaussians that pixels pull both ways the
hardest are split, as many as a plan allows that ends at the cap. A threshold (3DGS: 2e-4) assumes a
loss of a certain size; a rank does not, and the cap is met exactly. What counts is the sum over the
renders since the last time, not the mean of those that showed it (3DGS): what one view alone pulls at
may be that view's error (bench/results/splitting.md).
"""

import math
from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

from recon.scene.gaussians import Gaussians
from recon.splat import SplatStats
from recon.train.adam import Adam

OPACITY = 0.01
"""Least opacity of a Gaussian as dim as the reference, or dimmer: below it, it is pruned; a brighter one at
proportionally less, since a faint veil of a lamp still outshines a shadow (luminance-aware, as the alpha
floor of the rasteriser).
"""
SHRINK = 1.6
"""Factor by which the two that replace a split Gaussian are smaller."""


class DensityControl(Protocol):
    """Growth and pruning of the Gaussians on the way, as gsplat's Strategy: `train` takes any.

    Several ranks each have one and have to come to the same change, of which all tensors are on the
    Gaussians' device.
    """

    def due(self, position: float, total: int, step: float = 1) -> bool:
        """Return whether an adaptation lies on the last `step` of the way to this position on a schedule of
        `total`.

        With a step of 1 positions are iterations, counted from 1.
        """

    def adapt(
        self,
        gaussians: Gaussians,
        luminance: Tensor,
        stats: SplatStats,
        progress: float,
        generator: torch.Generator,
    ) -> "Change":
        """Return which Gaussians go, and which new ones come: decided, not yet done.

        luminance: [N] in scene units. stats: of all renders since the last adaptation. progress: position on
        the schedule, 0..1. generator: on the processor; the same one for the same seed and iteration.
        """


@dataclass(frozen=True)
class DensityRules:
    """Constants of growth; fractions are of the whole training. cap: most Gaussians."""

    cap: int
    begin: float = 0.05
    end: float = 0.6
    every: float = 0.025
    growth: float = 0.25
    """Largest share of the Gaussians that is split in one adaptation."""


@dataclass(frozen=True)
class Density:
    """The control by rules, of a scene whose `reference` is the radiance that opacities are judged by."""

    rules: DensityRules
    reference: float | None

    def due(self, position: float, total: int, step: float = 1) -> bool:
        """Return whether a multiple of `every`, from `begin` to `end`, lies on that step."""
        period = max(1, round(self.rules.every * total))
        passed = position // period
        first, last = self.rules.begin * total, self.rules.end * total
        return first <= passed * period <= last and passed > (position - step) // period

    def adapt(
        self,
        gaussians: Gaussians,
        luminance: Tensor,
        stats: SplatStats,
        progress: float,
        generator: torch.Generator,
    ) -> "Change":
        """Split the Gaussians that pixels pull at the hardest, and prune those that do not show.

        The split ones are replaced by two, drawn from the Gaussian itself along its axes, smaller by
        `SHRINK`, each of the opacity that lets as much light through as the one did, 1 - sqrt(1 - o).
        """
        count = len(gaussians)
        keep = self._visible(gaussians, luminance)
        score = torch.where(keep, stats.tension, 0.0)
        visible, steep = torch.stack([keep.sum(), (score > 0).sum()]).tolist()
        room = self._planned(progress, visible) - visible
        wanted = max(0, min(room, math.ceil(self.rules.growth * count), steep))
        split = torch.argsort(-score, stable=True)[:wanted].sort().values
        keep[split] = False
        children = [self._child(gaussians, split, generator) for _ in range(2)] if wanted else []
        new = (
            {name: torch.cat([child[name] for child in children]) for name in gaussians.parameters}
            if children
            else {}
        )
        return Change(keep, new)

    def _planned(self, progress: float, now: int) -> int:
        """Return how many Gaussians there may be at this moment: a straight line to the cap."""
        span = max(self.rules.end - self.rules.begin, 1e-9)
        adaptations = max(self.rules.end - progress, 0.0) / max(self.rules.every, 1e-9)
        step = (self.rules.cap - now) / max(adaptations, 1.0) if span > 0 else 0.0
        return min(self.rules.cap, now + max(0, math.ceil(step)))

    def _visible(self, gaussians: Gaussians, luminance: Tensor) -> Tensor:
        """Bool [N], the Gaussians worth their place; where none is, the most opaque one that is finite.

        A scene that is black keeps that one: a file without any Gaussian is refused by its readers.
        """
        opacity = gaussians.opacities().detach()
        share = (
            1.0 if self.reference is None else (self.reference / luminance.clamp_min(1e-30)).clamp_max(1.0)
        )
        finite = torch.ones_like(opacity, dtype=torch.bool)
        for value in gaussians.parameters.values():
            finite &= torch.isfinite(value.detach()).reshape(len(value), -1).all(1)
        visible = finite & (opacity >= OPACITY * share)
        if not visible.any() and finite.any():
            visible[torch.where(finite, opacity, -1.0).argmax()] = True
        return visible

    def _child(self, gaussians: Gaussians, split: Tensor, generator: torch.Generator) -> dict[str, Tensor]:
        child = gaussians.rows(split)
        scales = child["log_scales"].exp()
        offset = torch.randn(len(split), 3, generator=generator).to(scales.device) * scales
        child["means"] = child["means"] + rotate(child["quats"], offset)
        child["log_scales"] = child["log_scales"] - math.log(SHRINK)
        through = torch.sigmoid(-child["opacity_logits"]).sqrt()
        child["opacity_logits"] = torch.logit((1 - through).clamp(1e-6, 1 - 1e-6))
        return child


@dataclass(frozen=True)
class Change:
    """keep: bool [N], the Gaussians that stay; new: rows of every parameter that join behind them."""

    keep: Tensor
    new: dict[str, Tensor]

    def apply(self, gaussians: Gaussians, optimizer: Adam) -> None:
        """Apply it in place: the optimizer's state follows the Gaussians, new ones begin without any."""
        staying = self.keep.nonzero()[:, 0]
        for group in optimizer.param_groups:
            name = group["name"]
            if name not in gaussians.parameters:
                continue
            old = gaussians.parameters[name]
            rows = self.new.get(name, old.detach()[:0])
            fresh = _joined(old.detach(), staying, rows).requires_grad_(True)
            state = optimizer.state.pop(old, None)
            if state:
                for key in ("exp_avg", "exp_avg_sq"):
                    state[key] = _joined(state[key], staying, torch.zeros_like(rows))
                optimizer.state[fresh] = state
            group["params"] = [fresh]
            gaussians.parameters[name] = fresh


def _joined(rows: Tensor, staying: Tensor, new: Tensor) -> Tensor:
    """Some of the rows, and new ones behind them, without a copy on the way."""
    joined = rows.new_empty((len(staying) + len(new), *rows.shape[1:]))
    torch.index_select(rows, 0, staying, out=joined[: len(staying)])
    joined[len(staying) :] = new
    return joined


def rotate(quats: Tensor, vectors: Tensor) -> Tensor:
    """Vectors [N, 3] turned by quaternions [N, 4] wxyz of any length."""
    unit = quats / quats.norm(dim=1, keepdim=True).clamp_min(1e-12)
    real, imaginary = unit[:, :1], unit[:, 1:]
    twice = 2 * torch.linalg.cross(imaginary, vectors)
    turned: Tensor = vectors + real * twice + torch.linalg.cross(imaginary, twice)
    return turned

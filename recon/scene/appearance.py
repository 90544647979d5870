"""Appearance of a Gaussian by direction: two ways of parameterising linear radiance >= 0.

An appearance owns some of the parameters of a model. Each is a frozen dataclass of constants with
`start` (from colours to parameters), `rates` (learning rates), `colours`, `luminance` and `penalty`.
All work in *scene units*: radiance divided by the model's one normaliser.
"""

import math
from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

from recon.scene.harmonics import C0, COEFFICIENTS, series

Parameters = dict[str, Tensor]

ANCHOR = 0.8
"""The largest channel of a chromaticity, towards which it is pulled."""


@dataclass(frozen=True)
class Rate:
    """A learning rate that falls exponentially from `start` to `end` over the training."""

    start: float
    end: float

    def at(self, progress: float) -> float:
        """The rate when `progress` (0..1) of the training is done."""
        return float(self.start * (self.end / self.start) ** progress)


class Appearance(Protocol):
    """The part of a model that gives the Gaussians their colours."""

    @property
    def rates(self) -> dict[str, Rate]:
        """Learning rate of every parameter it owns."""
        ...

    def start(self, light: Tensor) -> Parameters:
        """Parameters that show `light` [N, C], linear, >= 0, the same from everywhere."""
        ...

    def colours(self, parameters: Parameters, directions: Tensor, degree: int) -> Tensor:
        """Linear radiance [N, C] >= 0 towards cameras at `directions` [N, 3] (camera to Gaussian)."""
        ...

    def luminance(self, parameters: Parameters) -> Tensor:
        """Return how bright each Gaussian is at most, roughly, without gradient: [N]."""
        ...

    def penalty(self, parameters: Parameters) -> Tensor:
        """Return what the appearance itself adds to the loss: a scalar."""
        ...


@dataclass(frozen=True)
class LuminanceChromaticity:
    """One scalar luminance a Gaussian times a bounded chromaticity that depends on the direction.

    `c(d) = L f(d)`, `f(d) = sum b_lm Y_lm(d)` (NH-3DGS, Zhang et al., arXiv 2511.12895). The paper
    does not say how f stays in [0, 1]; here `f = sigmoid(SH)`. ln L is the parameter: one step of
    Adam changes it by the same ratio whether the Gaussian is a lamp or a shadow. The pair has one
    degree of freedom too many, (L, f) -> (k L, f / k), which a weak pull of the largest channel of f
    towards `ANCHOR` removes.
    """

    pull: float = 1e-3
    floor: float = 2.0**-20
    stops: float = 17.0
    luminance_rate: Rate = Rate(0.03, 0.003)
    chroma_rate: Rate = Rate(0.03, 0.003)
    rest_rate: Rate = Rate(0.004, 0.0008)

    @property
    def rates(self) -> dict[str, Rate]:
        """ln L, and the constant and the direction-dependent coefficients of the chromaticity."""
        return {
            "ln_luminance": self.luminance_rate,
            "chroma_dc": self.chroma_rate,
            "chroma_rest": self.rest_rate,
        }

    def start(self, light: Tensor) -> Parameters:
        """L = largest channel / ANCHOR, f = light / L within [0.02, 0.98]."""
        luminance = (light.amax(1) / ANCHOR).clamp_min(self.floor)
        chroma = (light / luminance[:, None]).clamp(0.02, 0.98)
        return {
            "ln_luminance": luminance.log(),
            "chroma_dc": (torch.logit(chroma) / C0)[:, None],
            "chroma_rest": light.new_zeros(len(light), COEFFICIENTS - 1, light.shape[1]),
        }

    def colours(self, parameters: Parameters, directions: Tensor, degree: int) -> Tensor:
        """L times the chromaticity seen from `directions`."""
        ln_light = parameters["ln_luminance"]
        middle = ln_light.detach().median() if len(ln_light) else ln_light.new_zeros(())
        span = self.stops * math.log(2)
        # Straight-through: a Gaussian beyond the span is shown at its end and keeps its gradient.
        ln_light = ln_light + (ln_light.clamp(middle - span, middle + span) - ln_light).detach()
        chroma = series(parameters["chroma_dc"], parameters["chroma_rest"], directions, degree)
        return ln_light.exp()[:, None] * torch.sigmoid(chroma)

    def luminance(self, parameters: Parameters) -> Tensor:
        """L itself."""
        return parameters["ln_luminance"].detach().exp()

    def penalty(self, parameters: Parameters) -> Tensor:
        """Mean squared distance of the largest channel of the constant chromaticity from `ANCHOR`."""
        largest = torch.sigmoid(C0 * parameters["chroma_dc"][:, 0].amax(1))
        return self.pull * (largest - ANCHOR).square().mean()


@dataclass(frozen=True)
class PlainHarmonics:
    """`c(d) = max(SH(d) + 0.5, 0)`: the colours of 3DGS (Kerbl et al., arXiv 2308.04079), up to degree 2."""

    dc_rate: Rate = Rate(2.5e-3, 2.5e-3)
    rest_rate: Rate = Rate(2.5e-3 / 20, 2.5e-3 / 20)

    @property
    def rates(self) -> dict[str, Rate]:
        """The constant and the direction-dependent coefficients."""
        return {"sh_dc": self.dc_rate, "sh_rest": self.rest_rate}

    def start(self, light: Tensor) -> Parameters:
        """SH that show `light`."""
        return {
            "sh_dc": ((light - 0.5) / C0)[:, None],
            "sh_rest": light.new_zeros(len(light), COEFFICIENTS - 1, light.shape[1]),
        }

    def colours(self, parameters: Parameters, directions: Tensor, degree: int) -> Tensor:
        """The series plus one half, cut off at zero."""
        value = series(parameters["sh_dc"], parameters["sh_rest"], directions, degree)
        return (value + 0.5).clamp_min(0.0)

    def luminance(self, parameters: Parameters) -> Tensor:
        """The largest channel of the constant term."""
        return (C0 * parameters["sh_dc"].detach()[:, 0] + 0.5).amax(1).clamp_min(0.0)

    def penalty(self, parameters: Parameters) -> Tensor:
        """Zero: nothing is penalised."""
        return parameters["sh_dc"].new_zeros(())

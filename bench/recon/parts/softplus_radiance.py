"""Colours through a softplus: measured against those of the methods, and not taken."""

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn.functional import softplus

from recon.scene.appearance import Parameters, Rate
from recon.scene.harmonics import C0, COEFFICIENTS, series


@dataclass(frozen=True)
class SoftplusRadiance:
    """`c(d) = softplus(beta SH(d)) / beta`: the usual SH colour, made positive without a dead zone."""

    beta: float = 500.0
    dc_rate: Rate = Rate(4e-4, 4e-5)
    rest_rate: Rate = Rate(4e-5, 8e-6)

    @property
    def rates(self) -> dict[str, Rate]:
        """The constant and the direction-dependent coefficients."""
        return {"sh_dc": self.dc_rate, "sh_rest": self.rest_rate}

    def start(self, rgb: Tensor) -> Parameters:
        """The inverse of the softplus at `rgb`."""
        scaled = (rgb * self.beta).clamp_min(1e-4)
        inverse = torch.where(scaled > 20, scaled, torch.log(torch.expm1(scaled.clamp_max(20)))) / self.beta
        return {"sh_dc": (inverse / C0)[:, None], "sh_rest": rgb.new_zeros(len(rgb), COEFFICIENTS - 1, 3)}

    def colours(self, parameters: Parameters, directions: Tensor, degree: int) -> Tensor:
        """The series through the softplus."""
        value = series(parameters["sh_dc"], parameters["sh_rest"], directions, degree)
        return softplus(value, beta=self.beta)

    def luminance(self, parameters: Parameters) -> Tensor:
        """The largest channel of the constant term."""
        return softplus(C0 * parameters["sh_dc"].detach()[:, 0], beta=self.beta).amax(1)

    def penalty(self, parameters: Parameters) -> Tensor:
        """Zero: nothing is penalised."""
        return parameters["sh_dc"].new_zeros(())

"""Ways to colour and to blend that lost against what `recon` has, kept for the tables that say so."""

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from recon.appearance import Appearance, LuminanceChromaticity, Parameters, Rate
from recon.dataset import View
from recon.harmonics import C0, basis
from recon.observation import LinearLight

THIRD = 7
"""Harmonics of degree 3."""


@dataclass(frozen=True)
class ClampedChroma(LuminanceChromaticity):
    """`f = clamp(SH + 0.5, 0, 1)`: bounded by a cut-off, beyond which there is no gradient."""

    chroma_rate: Rate = Rate(0.006, 0.0006)
    rest_rate: Rate = Rate(0.0008, 0.00016)

    def start(self, rgb: Tensor) -> Parameters:
        """As of its class."""
        found = super().start(rgb)
        chroma = torch.sigmoid(C0 * found["chroma_dc"])
        return found | {"chroma_dc": (chroma - 0.5) / C0}

    def colours(self, parameters: Parameters, directions: Tensor, degree: int) -> Tensor:
        """Seen from `directions`."""
        values = basis(directions, degree)
        coefficients = torch.cat([parameters["chroma_dc"], parameters["chroma_rest"]], 1)[
            :, : values.shape[1]
        ]
        chroma = torch.einsum("nk,nkc->nc", values, coefficients)
        return parameters["ln_luminance"].exp()[:, None] * (chroma + 0.5).clamp(0.0, 1.0)

    def penalty(self, parameters: Parameters) -> Tensor:
        """The pull of the largest channel to the anchor."""
        largest = C0 * parameters["chroma_dc"][:, 0].amax(1) + 0.5
        return self.pull * (largest - self.anchor).square().mean()


@dataclass(frozen=True)
class ThirdDegree(LuminanceChromaticity):
    """Harmonics of up to degree 3, as 3DGS has them."""

    @property
    def rates(self) -> dict[str, Rate]:
        """Learning rates."""
        return super().rates | {"chroma_third": self.rest_rate}

    def start(self, rgb: Tensor) -> Parameters:
        """As of its class."""
        return super().start(rgb) | {"chroma_third": rgb.new_zeros(len(rgb), THIRD, 3)}

    def colours(self, parameters: Parameters, directions: Tensor, degree: int) -> Tensor:
        """Seen from `directions`."""
        if degree < 3:
            return super().colours(parameters, directions, degree)
        coefficients = torch.cat([parameters["chroma_dc"], parameters["chroma_rest"]], 1)
        chroma = torch.einsum("nk,nkc->nc", basis(directions, 2), coefficients)
        chroma = chroma + torch.einsum("nk,nkc->nc", third(directions), parameters["chroma_third"])
        return parameters["ln_luminance"].exp()[:, None] * torch.sigmoid(chroma)


def third(directions: Tensor) -> Tensor:
    """The seven real harmonics of degree 3 at unit directions [N, 3]: [N, 7], signs as in 3DGS."""
    x, y, z = directions.unbind(-1)
    xx, yy, zz = x * x, y * y, z * z
    return torch.stack(
        [
            -0.5900435899266435 * y * (3 * xx - yy),
            2.890611442640554 * x * y * z,
            -0.4570457994644658 * y * (4 * zz - xx - yy),
            0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy),
            -0.4570457994644658 * x * (4 * zz - xx - yy),
            1.445305721320277 * z * (xx - yy),
            -0.5900435899266435 * x * (xx - 3 * yy),
        ],
        -1,
    )


@dataclass(frozen=True)
class LogBlended:
    """Colours as `ln(1 + c / floor)`, to be blended as such."""

    linear: Appearance
    floor: float

    @property
    def rates(self) -> dict[str, Rate]:
        """Learning rates."""
        return self.linear.rates

    def start(self, rgb: Tensor) -> Parameters:
        """As of its class."""
        return self.linear.start(rgb)

    def colours(self, parameters: Parameters, directions: Tensor, degree: int) -> Tensor:
        """Seen from `directions`."""
        return torch.log1p(self.linear.colours(parameters, directions, degree) / self.floor)

    def luminance(self, parameters: Parameters) -> Tensor:
        """That of the linear colours."""
        return self.linear.luminance(parameters)

    def penalty(self, parameters: Parameters) -> Tensor:
        """The pull of the largest channel to the anchor."""
        return self.linear.penalty(parameters)


@dataclass
class LogBlending(LinearLight):
    """Takes the blend of `LogBlended` colours back to light before anything else."""

    floor: float = 2.0**-20

    def compare(self, image: Tensor, *rest: Any) -> tuple[Tensor, Tensor]:
        """Prediction and target, of light."""
        return super().compare(self._light(image), *rest)

    def predict(self, image: Tensor, view: View, k: float) -> Tensor:
        """The signal of a shot, of light."""
        return super().predict(self._light(image), view, k)

    def radiance(self, image: Tensor) -> Tensor:
        """Linear radiance."""
        return super().radiance(self._light(image))

    def _light(self, image: Tensor) -> Tensor:
        return torch.expm1(image) * self.floor

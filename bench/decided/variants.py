"""Ways to colour, blend and compare that lost against what `recon` has, kept for the tables that say so."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any
from unittest import mock

import torch
from torch import Tensor

from recon.data.dataset import View
from recon.observe.linear import LinearLight
from recon.observe.photographs import ToneCurve
from recon.observe.tone_grid import apply_curve, curve_values
from recon.scene.appearance import Appearance, LuminanceChromaticity, Parameters, Rate
from recon.scene.gaussians import Gaussians, Renderer
from recon.scene.harmonics import C0, basis
from recon.splat import Render, SplatCamera

THIRD = 7
"""Harmonics of degree 3."""


@dataclass(frozen=True)
class ClampedChroma(LuminanceChromaticity):
    """`f = clamp(SH + 0.5, 0, 1)`: bounded by a cut-off, beyond which there is no gradient."""

    chroma_rate: Rate = Rate(0.006, 0.0006)
    rest_rate: Rate = Rate(0.0008, 0.00016)

    def start(self, rgb: Tensor) -> Parameters:
        """Start as its class."""
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
        """Start as its class."""
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
class _OfLinear:
    """Colours that are made of those of another appearance; all else is as that has it."""

    linear: Appearance

    @property
    def rates(self) -> dict[str, Rate]:
        """Learning rates."""
        return self.linear.rates

    def start(self, rgb: Tensor) -> Parameters:
        """Start as its class."""
        return self.linear.start(rgb)

    def luminance(self, parameters: Parameters) -> Tensor:
        """Luminance of the linear colours."""
        return self.linear.luminance(parameters)

    def penalty(self, parameters: Parameters) -> Tensor:
        """The pull of the largest channel to the anchor."""
        return self.linear.penalty(parameters)


@dataclass(frozen=True)
class LogBlended(_OfLinear):
    """Colours as `ln(1 + c / floor)`, to be blended as such."""

    floor: float

    def colours(self, parameters: Parameters, directions: Tensor, degree: int) -> Tensor:
        """Seen from `directions`."""
        return torch.log1p(self.linear.colours(parameters, directions, degree) / self.floor)


@dataclass
class LogBlending(LinearLight):
    """Takes the blend of `LogBlended` colours back to light before anything else."""

    floor: float = 2.0**-20

    def compare(self, image: Tensor, *rest: Any) -> tuple[Tensor, Tensor]:
        """Prediction and target, of light."""
        return super().compare(self._light(image), *rest)

    def predict(self, image: Tensor, view: View, k: float, band: int | None = None) -> Tensor:
        """The signal of a shot, of light."""
        return super().predict(self._light(image), view, k)

    def radiance(self, image: Tensor) -> Tensor:
        """Linear radiance."""
        return super().radiance(self._light(image))

    def _light(self, image: Tensor) -> Tensor:
        return torch.expm1(image) * self.floor


@dataclass(frozen=True)
class Toned(_OfLinear):
    """Colours that already went through a tone curve at an exposure: codes, to be blended as such."""

    curve: "CurveOfGaussians"
    values: Tensor
    k: float

    def colours(self, parameters: Parameters, directions: Tensor, degree: int) -> Tensor:
        """Codes of every Gaussian; those that the leak puts below 0 are 0."""
        light = self.linear.colours(parameters, directions, degree)
        return self.curve.toned(light, self.values, self.k)


@dataclass(frozen=True)
class Remembering(Renderer):
    """Leaves what it drew last where `CurveOfGaussians` finds it."""

    def __call__(self, gaussians: Gaussians, camera: SplatCamera, **options: Any) -> Render:
        """Evaluate as its class."""
        CurveOfGaussians.last = self, gaussians, camera, options
        return super().__call__(gaussians, camera, **options)


class CurveOfGaussians(ToneCurve):
    """Compares twice: light blended and then toned, and Gaussians toned one by one and then blended.

    The loss of GaussHDR (CVPR 2025) on every Gaussian, beside that on every pixel, of the same weight. It
    takes one more rendering for each shot. Vignetting is left out of the second.
    """

    last: tuple[Renderer, Gaussians, SplatCamera, dict[str, Any]]

    def compare(
        self, image: Tensor, view: View, progress: float, factors: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """Predicted and photographed codes, the errors balanced, [2 * shots * 3, H, W]."""
        prediction, target = super().compare(image, view, progress, factors)
        if not torch.is_grad_enabled():
            return prediction, target
        renderer, gaussians, camera, options = self.last
        theta = self.theta if self.moves(progress) else self.theta.detach()
        values, drawn = curve_values(theta[self.of_camera[view.camera]]), []
        for shot in view.shots:
            toned = Toned(renderer.appearance, self, values, shot.k)
            own = Renderer(toned, renderer.limits)
            drawn.append(own(gaussians, camera, degree=options["degree"]).image.movedim(2, 0))
        codes = self._prepared.of(view, lambda: self._weighted(view), image.device)
        beside = codes.bound(torch.cat(drawn), target).reshape(-1, 3, *target.shape[1:])
        assert codes.weight is not None
        beside = torch.lerp(target.reshape(beside.shape), beside, codes.weight).flatten(0, 1)
        return torch.cat([prediction, beside]), torch.cat([target, target])

    def toned(self, light: Tensor, values: Tensor, k: float) -> Tensor:
        """Codes [N, 3] of light [N, 3] at an exposure scale, by the values of a camera's curves [3, M]."""
        x = self.rate * (torch.log(light + self.epsilon) + math.log(self.normaliser * k) - self.middle)
        channels = [
            apply_curve(x[:, channel].contiguous(), values[channel], self.nodes, leaky=True)
            for channel in range(3)
        ]
        return torch.stack(channels, 1).clamp_min(0.0)


@contextmanager
def curve_of_gaussians() -> Iterator[None]:
    """HDR-GS with `CurveOfGaussians`."""
    with (
        mock.patch("recon.observe.calibrated_curves.ToneCurve", CurveOfGaussians),
        mock.patch("recon.train.training.Renderer", Remembering),
    ):
        yield

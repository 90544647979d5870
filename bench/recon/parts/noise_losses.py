"""Losses for noisy mosaics that were tried against the one that rig trains with.

All compare the signal of a mosaic, plane by plane, with what the render makes of it. `Whitened` divides the
residual by the sensor's standard deviation at the predicted signal, taken as a number (Raw3DGS, Li et al.,
arXiv 2406.08300, wants what is left to be noise of unit variance); `RelativeSquares` is the loss of
RawNeRF (Mildenhall et al., CVPR 2022); `Stabilised` compares in units of the noise by the curve that makes it
constant (Anscombe 1948), with rig's own L1 and SSIM.
"""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d

from imaging.merge.linear_frame import SensorSignalNoise
from recon.data.dataset import View
from recon.observe.linear import LinearLight, split, through_filter

RAWNERF_EPSILON = 1e-3
SCALES = 3
"""Scales of `coarse_to_fine`: single photosites, and means of 2x2 and 4x4 of a plane."""


@dataclass
class _Signal(LinearLight):
    """Prediction and target as plain signals; clipped where the sensor was."""

    def signals(self, image: Tensor, view: View) -> tuple[Tensor, Tensor, SensorSignalNoise]:
        """Both [4, H/2, W/2], and the noise."""
        prepared = self._prepared.of(view, lambda: self._prepare(view), image.device)
        (shot,) = view.shots
        assert isinstance(shot.noise, SensorSignalNoise)
        light = through_filter(image, prepared.filters) * prepared.falloff
        assert view.sensor.cfa is not None
        target = split(torch.from_numpy(shot.pixels), view.sensor.cfa.period)
        predicted = light * prepared.scales[0]
        if (ceiling := prepared.ceiling()) is not None:
            predicted = torch.minimum(predicted, torch.where(torch.isfinite(ceiling[0]), target, torch.inf))
        return predicted, target, shot.noise


@dataclass
class Whitened(_Signal):
    """Loss in standard deviations of the noise at the predicted signal."""

    def compare(
        self, image: Tensor, view: View, progress: float, factors: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """Both over sigma, [4, H/2, W/2]."""
        predicted, target, noise = self.signals(image, view)
        sigma = (noise.slope * predicted.detach().clamp_min(0.0) + noise.floor).sqrt()
        return predicted / sigma, target / sigma


@dataclass
class RelativeSquares(_Signal):
    """Loss relative to the predicted signal."""

    def compare(
        self, image: Tensor, view: View, progress: float, factors: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """Both over the prediction plus a thousandth of white, [4, H/2, W/2]."""
        predicted, target, _ = self.signals(image, view)
        weight = 1 / (predicted.detach() + RAWNERF_EPSILON).clamp_min(RAWNERF_EPSILON)
        return predicted * weight, target * weight


@dataclass
class Stabilised(_Signal):
    """Loss on the scale on which the noise is the same everywhere, black at 0 and white at 1."""

    def compare(
        self, image: Tensor, view: View, progress: float, factors: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """Both stabilised, [4, H/2, W/2]."""
        predicted, target, noise = self.signals(image, view)
        floor, slope = noise.floor, noise.slope
        black: float = floor**0.5
        white: float = (slope + floor) ** 0.5

        def stable(signal: Tensor) -> Tensor:
            root = (slope * signal.abs() + floor).sqrt() - black
            return root.copysign(signal) / (white - black)

        return stable(predicted), stable(target)


@dataclass(frozen=True)
class Residual:
    """A loss that is a function of the residual, times a weight that makes it about as large as rig's own."""

    function: Callable[[Tensor], Tensor]
    weight: float = 0.03

    def __call__(self, prediction: Tensor, target: Tensor) -> Tensor:
        """A scalar."""
        return self.weight * self.function(prediction - target)


def squares(residual: Tensor) -> Tensor:
    """Mean square."""
    return residual.square().mean()


def coarse_to_fine(residual: Tensor) -> Tensor:
    """Mean square at several scales: of white noise each is as large as the finest.

    What the residual has in common over an area counts more than what single photosites have.
    """
    total, plane = residual.square().mean(), residual[None]
    for _ in range(1, SCALES):
        plane = 2 * avg_pool2d(plane, 2)
        total = total + plane.square().mean()
    return total / SCALES

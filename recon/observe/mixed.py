"""Observation model of a rig of which some cameras give linear light and others photographs."""

from dataclasses import dataclass

import torch
from torch import Tensor

from recon.data.dataset import Dataset, View
from recon.data.light import Light
from recon.observe.band_observation import BandedLight
from recon.observe.calibrated_curves import tone_curve
from recon.observe.linear import LinearLight, Observation
from recon.observe.photographs import ToneCurve
from recon.scene.appearance import Rate


@dataclass
class Mixed(Observation):
    """Every view by its own camera: linear light as it is, photographs through the tone curve.

    Both read a rendered image in the same units. What ties the two gauges together is the calibration,
    whose gain of a camera is measured on the points that it shares with the others.
    """

    linear: LinearLight
    photographs: ToneCurve

    @property
    def shared(self) -> dict[str, Tensor]:
        """The tone curves."""
        return self.photographs.shared

    @property
    def rates(self) -> dict[str, Rate]:
        """Learning rates of the curves."""
        return self.photographs.rates

    def to(self, device: torch.device) -> None:
        """Move the curves."""
        self.photographs.to(device)

    def compare(
        self, image: Tensor, view: View, progress: float, factors: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """Compare by the kind of the view."""
        return self._of(view).compare(image, view, progress, factors)

    def predict(self, image: Tensor, view: View, k: float, band: int | None = None) -> Tensor:
        """Predict by the kind of the view."""
        return self._of(view).predict(image, view, k, band)

    def radiance(self, image: Tensor) -> Tensor:
        """The image times the normaliser."""
        return self.linear.radiance(image)

    def units(self, radiance: Tensor) -> Tensor:
        """The inverse of `radiance`."""
        return self.linear.units(radiance)

    def penalty(self, progress: float) -> Tensor | float:
        """Penalty of the curves."""
        return self.photographs.penalty(progress)

    def _of(self, view: View) -> Observation:
        return self.photographs if view.sensor.kind == "ldr" else self.linear


def linear_or_mixed(dataset: Dataset, light: Light) -> Observation:
    """LinearLight, or that of bands, unless some of the session's cameras give photographs."""
    if dataset.bands:
        return BandedLight(light.normaliser)
    linear = LinearLight(light.normaliser)
    photographs = any(view.sensor.kind == "ldr" for view in dataset.views)
    return Mixed(linear, tone_curve(dataset, light)) if photographs else linear

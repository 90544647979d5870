"""Observation model of mono cameras behind filters: every shot shows one channel of the scene."""

from dataclasses import dataclass, field

import torch
from torch import Tensor

from recon.data.dataset import View
from recon.observe.glare import scattered
from recon.observe.linear import SIGNAL_MU, Observation
from recon.observe.losses.photometric import exposed_mu_law, mu_law
from recon.observe.targets import Targets


@dataclass(frozen=True)
class _Prepared:
    """Constant inputs of a view, for J shots in order of their bands.

    rows: of each channel that was seen, its shots. falloff [H, W]; scales [J, 1, 1]; target, saturated, valid
    [J, H, W].
    """

    rows: dict[int, slice]
    falloff: Tensor
    scales: Tensor
    target: Tensor
    saturated: Tensor
    valid: Tensor

    def ceiling(self, rows: slice) -> Tensor:
        """The target of some shots where that is saturated, else infinite."""
        return torch.where(self.saturated[rows], self.target[rows], torch.inf)


@dataclass
class BandedLight(Observation):
    """RAW of mono cameras, every exposure compared in its own mu-law: `x = falloff L_band k`.

    Saturated photosites are one-sided, as in `recon.observe.linear`.
    """

    normaliser: float
    _prepared: Targets[_Prepared] = field(default_factory=Targets, repr=False)

    def compare(
        self, image: Tensor, view: View, progress: float, factors: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """All shots, band by band and darkest first: [shots, H, W], from an image [H, W, channels]."""
        prepared = self._prepared.of(view, lambda: self._prepare(view), image.device)
        image = scattered(image, view.sensor.glare)
        scales = prepared.scales if factors is None else prepared.scales * factors[:, None, None]
        prediction = torch.cat(
            [
                exposed_mu_law(
                    image[:, :, band] * prepared.falloff, scales[rows], prepared.ceiling(rows), SIGNAL_MU
                )
                for band, rows in prepared.rows.items()
            ]
        )
        return torch.where(prepared.valid, prediction, prepared.target), prepared.target

    def predict(self, image: Tensor, view: View, k: float, band: int | None = None) -> Tensor:
        """The signal x [H, W] behind the filter of a band."""
        assert band is not None, "every shot has a band"
        falloff = torch.as_tensor(view.sensor.falloff, dtype=image.dtype, device=image.device)
        light = scattered(image, view.sensor.glare)
        return light[:, :, band] * falloff * (self.normaliser * k)

    def radiance(self, image: Tensor) -> Tensor:
        """The image times the normaliser."""
        return image * self.normaliser

    def units(self, radiance: Tensor) -> Tensor:
        """Radiance over the normaliser."""
        return radiance / self.normaliser

    def _prepare(self, view: View) -> _Prepared:
        bands = [shot.band for shot in view.shots]
        rows = {
            band: slice(bands.index(band), bands.index(band) + bands.count(band))
            for band in bands
            if band is not None
        }
        target = torch.stack([mu_law(torch.from_numpy(shot.pixels), SIGNAL_MU) for shot in view.shots])
        saturated = torch.stack([torch.tensor(shot.saturated) for shot in view.shots])
        return _Prepared(
            rows,
            falloff=torch.from_numpy(view.sensor.falloff),
            scales=torch.tensor([self.normaliser * shot.k for shot in view.shots])[:, None, None],
            target=target,
            saturated=saturated,
            valid=torch.stack([torch.tensor(shot.valid) for shot in view.shots]),
        )

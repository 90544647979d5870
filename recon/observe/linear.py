"""Observation model of linear light: from a rendered image to predicted shots, and the target.

An observation model turns a rendered image (linear Rec.709, in scene units: radiance divided by the
model's normaliser) and a view into two stacks of planes, prediction and target, in which the loss
compares them. Each shot of a bracket is an observation of one render.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import conv2d

from imaging.arrays import Array32
from imaging.sensor.cfa import Cfa
from recon.data.dataset import View
from recon.observe.glare import scattered
from recon.observe.kernels.linear_kernel import Sites, recorded
from recon.observe.losses.photometric import exposed_mu_law, mu_law
from recon.observe.targets import Targets
from recon.scene.appearance import Rate

MIDDLE_GREY = 0.18
SIGNAL_MU = 500.0
"""Mu of the signal of a sensor. With the 5000 of the papers the noise of its darkest tones weighs more: 0.24
dB less, and 0.39 less in RAW (bench/results/ablation.md).
"""
LIGHT_MU = 5000.0
"""Mu of light, which has no known noise floor and reaches far above its white: EXR."""


class Observation(ABC):
    """The part of a model that knows about cameras; of itself it has nothing that is trained."""

    display_values: bool = False
    """True if an image holds display values, which end where a display does, in steps that it can show."""

    @property
    def shared(self) -> dict[str, Tensor]:
        """Parameters of the model that belong to no Gaussian, such as a tone curve."""
        return {}

    @property
    def rates(self) -> dict[str, Rate]:
        """Learning rate of every shared parameter."""
        return {}

    def to(self, device: torch.device) -> None:  # noqa: B027  there is nothing to move
        """Move the shared parameters to a device; views follow the first image they are compared with."""

    @abstractmethod
    def compare(
        self, image: Tensor, view: View, progress: float, factors: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """Prediction and target, [P, h, w] each, from an image [H, W, 3]; progress is 0..1.

        factors [shots]: on the exposure scale of each shot; differentiable in them too.
        """
        ...

    @abstractmethod
    def predict(self, image: Tensor, view: View, k: float, band: int | None = None) -> Tensor:
        """Return what a shot of exposure scale `k` through the filter of a band would hold, unclipped: like
        `Shot.pixels`.
        """
        ...

    @abstractmethod
    def radiance(self, image: Tensor) -> Tensor:
        """The rendered image as linear radiance, in the units of the calibration."""
        ...

    @abstractmethod
    def units(self, radiance: Tensor) -> Tensor:
        """Radiance [N, 3] as a rendered image would hold it: the inverse of `radiance`."""
        ...

    def penalty(self, progress: float) -> Tensor | float:
        """Return what the model itself adds to the loss; progress is 0..1."""
        return 0.0


def split(image: Tensor, period: tuple[int, int]) -> Tensor:
    """The sites of the tiles of an image [H, W, ...]: [P, H / rows, W / columns, ...], in reading order.

    period: rows and columns of a tile, of which H and W are multiples; P: its sites.
    """
    (height, width), (rows, columns) = image.shape[:2], period
    tiles = image.reshape(height // rows, rows, width // columns, columns, *image.shape[2:])
    return tiles.movedim(1, 0).movedim(3, 1).flatten(0, 1)


def join(planes: Tensor, period: tuple[int, int]) -> Tensor:
    """The inverse of `split`: [P, h, w, ...] -> [rows h, columns w, ...]."""
    tiles = planes.reshape(*period, *planes.shape[1:]).movedim((2, 0, 3, 1), (0, 1, 2, 3))
    return tiles.flatten(2, 3).flatten(0, 1)


def through_filter(image: Tensor, filters: Tensor) -> Tensor:
    """Linear Rec.709 [H, W, 3] behind `colour_filters`: planes as `split` has them, or [channels, H, W]
    without CFA.
    """
    return conv2d(image.movedim(2, 0)[None], filters, stride=filters.shape[2:])[0]


def colour_filters(matrix: Tensor, cfa: Cfa | None) -> Tensor:
    """Kernels of a convolution in steps of one tile: kernel p sees nothing but site p of the tile.

    [P, 3, rows, columns] of the tile, or [channels, 3, 1, 1] without CFA. `matrix` is camera_from_rec709
    [channels, 3]. Each plane of a mosaic is one site of the tile, so the two greens of Bayer stay apart; only
    the channel that the site lets through is computed.
    """
    if cfa is None:
        return matrix[:, :, None, None]
    rows, columns = cfa.period
    filters = matrix.new_zeros(rows * columns, 3, rows, columns)
    for site, channel in enumerate(cfa.pattern.reshape(-1)):
        filters[site, :, site // columns, site % columns] = matrix[int(channel)]
    return filters


def _sites(matrix: Array32, cfa: Cfa | None) -> Sites:
    """The planes of `through_filter`: the sites of the tile, or all channels at each pixel."""
    if cfa is None:
        return Sites((1, 1), np.zeros((len(matrix), 2), np.int64), np.ascontiguousarray(matrix))
    offsets = np.stack([place.ravel() for place in np.indices(cfa.period)], -1)
    return Sites(cfa.period, offsets, matrix[cfa.pattern.ravel()])


@dataclass(frozen=True)
class _Prepared:
    """Constant inputs of a view, for J shots of P planes.

    falloff [P, h, w]; scales [J, 1, 1, 1]; target, saturated and valid [J, P, h, w]; saturated is None if no
    sample is, valid None if every one is.
    """

    filters: Tensor
    sites: Sites
    falloff: Tensor
    scales: Tensor
    target: Tensor
    saturated: Tensor | None
    valid: Tensor | None
    mu: float

    def ceiling(self) -> Tensor | None:
        """The target where that is saturated, else infinite, [J, P, h, w]; None if no sample is saturated."""
        return None if self.saturated is None else torch.where(self.saturated, self.target, torch.inf)


def _white(light: np.ndarray) -> float:
    """White of an EXR, whose numbers may have any unit: where its median is middle grey."""
    lit = light[light > 0]
    return float(np.median(lit)) / MIDDLE_GREY if lit.size else 1.0


@dataclass
class LinearLight(Observation):
    """RAW mosaics, camera RGB and linear EXR, every exposure compared in its own mu-law.

    A shot of scale k should show `x = falloff (M L)_channel k`, mosaicked by the camera's own CFA.
    Saturated photosites are one-sided. SSIM works on the planes of single sites of the tile, four of
    half the resolution for Bayer, not on the mosaic, whose checkerboard would dominate every window (NH-3DGS,
    arXiv 2511.12895). Planes of larger tiles are small (36 for X-Trans); SSIM on means of channels over cells
    instead was as good (toy-x-trans, 96x72: 31.36 and 31.37 dB, without SSIM 31.10).
    """

    normaliser: float
    _prepared: Targets[_Prepared] = field(default_factory=Targets, repr=False)

    def compare(
        self, image: Tensor, view: View, progress: float, factors: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """All shots of the bracket, darkest first: [shots * P, h, w], planes as of `through_filter`."""
        prepared = self._prepared.of(view, lambda: self._prepare(view), image.device)
        image = scattered(image, view.sensor.glare)
        scales = prepared.scales if factors is None else prepared.scales * factors[:, None, None, None]
        if image.device.type == "cpu" and image.dtype == torch.float32:
            prediction = recorded(
                image, scales.reshape(-1), prepared.sites, prepared.falloff, prepared.target,
                prepared.saturated, prepared.valid, prepared.mu,
            )  # fmt: skip
            return prediction.flatten(0, 1), prepared.target.flatten(0, 1)
        light = through_filter(image, prepared.filters.to(image.dtype)) * prepared.falloff
        prediction = exposed_mu_law(light, scales, prepared.ceiling(), prepared.mu)
        if prepared.valid is not None:
            prediction = torch.where(prepared.valid, prediction, prepared.target)
        return prediction.flatten(0, 1), prepared.target.flatten(0, 1)

    def predict(self, image: Tensor, view: View, k: float, band: int | None = None) -> Tensor:
        """The signal x: [H, W] for a mosaic, [H, W, channels] without CFA."""
        sensor = view.sensor
        filters = colour_filters(torch.from_numpy(sensor.camera_from_rec709), sensor.cfa).to(image)
        planes = through_filter(scattered(image, sensor.glare), filters)
        falloff = torch.as_tensor(sensor.falloff, dtype=image.dtype, device=image.device)
        scale = self.normaliser * k
        if sensor.cfa is None:
            return planes.movedim(0, 2) * falloff[..., None] * scale
        return join(planes, sensor.cfa.period) * falloff * scale

    def radiance(self, image: Tensor) -> Tensor:
        """The image times the normaliser."""
        return image * self.normaliser

    def units(self, radiance: Tensor) -> Tensor:
        """Radiance over the normaliser."""
        return radiance / self.normaliser

    def compression(self, view: View) -> tuple[list[float], float]:
        """The value of each shot that counts as 1 in the mu-law, and its mu."""
        if view.sensor.kind == "hdr":
            return [_white(shot.pixels[shot.valid]) for shot in view.shots], LIGHT_MU
        return [1.0] * len(view.shots), SIGNAL_MU

    def _prepare(self, view: View) -> _Prepared:
        sensor = view.sensor
        period = None if sensor.cfa is None else sensor.cfa.period

        def planes(array: np.ndarray) -> Tensor:
            tensor = torch.from_numpy(np.ascontiguousarray(array))
            return tensor.movedim(2, 0) if period is None else split(tensor, period)

        falloff = torch.from_numpy(sensor.falloff)
        scales = [self.normaliser * shot.k for shot in view.shots]
        units, mu = self.compression(view)
        pairs = list(zip(view.shots, scales, units, strict=True))
        target = torch.stack([mu_law(planes(shot.pixels) / unit, mu) for shot, _, unit in pairs])
        saturated = torch.stack([planes(shot.saturated) for shot in view.shots])
        valid = torch.stack([planes(shot.valid) for shot in view.shots])
        matrix = sensor.camera_from_rec709.astype(np.float32)
        return _Prepared(
            filters=colour_filters(torch.from_numpy(matrix), sensor.cfa),
            sites=_sites(matrix, sensor.cfa),
            falloff=falloff[None] if period is None else split(falloff, period),
            scales=torch.tensor([scale / unit for _, scale, unit in pairs])[:, None, None, None],
            target=target.contiguous(),
            saturated=saturated.contiguous() if bool(saturated.any()) else None,
            valid=None if bool(valid.all()) else valid.contiguous(),
            mu=mu,
        )

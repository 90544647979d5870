"""Observation models for photographs: through a learned tone curve, or as they are."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from torch import Tensor

from imaging.arrays import Array, Array32
from imaging.merge.linear_frame import decode
from imaging.session.calibration import Response
from recon.data.dataset import View
from recon.data.tone import encode
from recon.observe.glare import scattered
from recon.observe.kernels.display_kernel import photographed
from recon.observe.linear import Observation
from recon.observe.targets import Targets
from recon.observe.tone_grid import apply_curve, curve_values, roughness
from recon.scene.appearance import Rate

LAST_CODE = 1.5 / 255
"""Distance of a code from an end of the scale within which it only bounds the light."""

DISPLAY_POWER = 1 / 2.2
"""Display values are about light to this power."""

TYPICAL_SLOPE, LEAST_SLOPE = 0.1, 0.02
"""Codes, of 1, a natural log of light: of a pixel of weight 1, and the least that one is weighted by."""


@dataclass(frozen=True)
class _Codes:
    """Planes [shots * 3, H, W] of a view's photographs, and the range in which they distinguish
    predictions.

    A code at the upper end of the scale is a lower bound only: predictions above it count as equal to it. One
    at the lower end is an upper bound. above and below say where predictions beyond the code on that side
    count as it; both are True where a shot is invalid; None: nowhere. Codes within the scale are compared
    wherever the calibration ends: it is of the photographs it had, and a lamp beyond them would be free to be
    of any brightness. stored: the codes, as whole numbers of 8 bits where these give every bit of them.
    weight: of errors, [3, H, W]; None: 1.
    """

    stored: Tensor
    below: Tensor | None
    above: Tensor | None
    weight: Tensor | None = None

    def target(self) -> Tensor:
        """The codes, 0..1."""
        return _divided(self.stored) if self.stored.dtype == torch.uint8 else self.stored

    def bound(self, prediction: Tensor, target: Tensor) -> Tensor:
        """Clamp the prediction to the range that the codes distinguish."""
        floor = None if self.below is None else torch.where(self.below, target, -torch.inf)
        ceiling = None if self.above is None else torch.where(self.above, target, torch.inf)
        return prediction if floor is None and ceiling is None else prediction.clamp(floor, ceiling)


def _divided(whole: Tensor) -> Tensor:
    """Codes of 8 bits over 255. By a tensor: GPUs divide by a number as they multiply by its inverse."""
    return whole / torch.full((1,), 255.0, device=whole.device)


def _by_shot(planes: Tensor) -> Tensor:
    """Planes [shots * 3, H, W] as [shots, 3, H, W]."""
    return planes.reshape(-1, 3, *planes.shape[1:])


def _codes(view: View) -> _Codes:
    def planes(name: str) -> Tensor:
        stack = np.concatenate([getattr(shot, name).transpose(2, 0, 1) for shot in view.shots])
        return torch.from_numpy(np.ascontiguousarray(stack))

    target, ignored = planes("pixels"), ~planes("valid")
    below = planes("dark") & (target <= LAST_CODE) | ignored
    above = planes("saturated") & (target >= 1 - LAST_CODE) | ignored
    whole = (255 * target).round().clamp(0, 255).to(torch.uint8)
    stored = whole if torch.equal(_divided(whole), target) else target
    return _Codes(stored, below if bool(below.any()) else None, above if bool(above.any()) else None)


@dataclass
class ToneCurve(Observation):
    """Code values through one monotone curve a channel: `C = g(r (ln (E + eps) + ln w k - m))`.

    HDRGS (Wu et al., arXiv 2408.06543); w is the photograph's white balance. theta [R, 3, M - 1]: the curves
    of R different responses. `of_camera` says which a camera has. The curve is fixed for the first `fixed` of
    the training, or for all of it when the response is known. Scale gauge: m is that of the calibration's
    response, so radiance stays in the units of the calibration as far as the curve does not drift along x.

    balance: errors of codes count `(0.1 / s) ** balance` times, s being how many codes the shots of a pixel
    change in the mean when its light grows by a natural log. With 0 an error counts by the code, and the
    shoulder of the curve hides lamps and their edges; with 1 by the ratio of light, wherever on the curve.
    """

    normaliser: float
    nodes: Tensor
    theta: Tensor
    of_camera: dict[str, int]
    rate: float
    middle: float
    epsilon: float
    fixed: float = 0.2
    smoothness: float = 1e-2
    balance: float = 0.5
    curve_rate: Rate = Rate(2e-2, 5e-6)
    _prepared: Targets[_Codes] = field(default_factory=Targets, repr=False)

    def __post_init__(self) -> None:
        # Weights are those of the curve at the start, also when a training goes on from a later one.
        self._start = curve_values(self.theta.detach().cpu()).double().numpy()
        self._slopes = self.rate * np.gradient(self._start, self.nodes.cpu().double().numpy(), axis=-1)

    @property
    def learned(self) -> bool:
        """True if the curve is trained."""
        return self.fixed < 1.0

    @property
    def shared(self) -> dict[str, Tensor]:
        """The curves."""
        return {"theta": self.theta}

    @property
    def rates(self) -> dict[str, Rate]:
        """Learning rate of the curve."""
        return {"theta": self.curve_rate}

    def to(self, device: torch.device) -> None:
        """Move the curves and their nodes."""
        self.theta, self.nodes = self.theta.to(device), self.nodes.to(device)

    def compare(
        self, image: Tensor, view: View, progress: float, factors: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """Predicted and photographed codes of all shots, the errors balanced, [shots * 3, H, W]."""
        codes = self._prepared.of(view, lambda: self._weighted(view), image.device)
        assert codes.weight is not None
        target = codes.target()
        scales = [shot.k for shot in view.shots]
        curves = self.theta if self.moves(progress) else self.theta.detach()
        prediction = self._expose(image, view, scales, factors, curves, leaky=True).flatten(0, 1)
        prediction = codes.bound(prediction, target)
        return torch.lerp(_by_shot(target), _by_shot(prediction), codes.weight).flatten(0, 1), target

    def predict(self, image: Tensor, view: View, k: float, band: int | None = None) -> Tensor:
        """Codes of a shot of exposure scale `k`, within 0..1, [H, W, 3]."""
        return self._expose(image, view, [k], None, self.theta.detach(), leaky=False)[0].movedim(0, 2)

    def radiance(self, image: Tensor) -> Tensor:
        """The image times the normaliser."""
        return image * self.normaliser

    def units(self, radiance: Tensor) -> Tensor:
        """The inverse of `radiance`."""
        return radiance / self.normaliser

    def penalty(self, progress: float) -> Tensor | float:
        """Roughness of the curves, while they are trained."""
        if not self.moves(progress):
            return 0.0
        return self.smoothness * roughness(curve_values(self.theta), self.nodes)

    def moves(self, progress: float) -> bool:
        """Return whether the curves are trained at this share of the training, 0..1."""
        return self.learned and progress >= self.fixed

    def curves(self) -> Tensor:
        """Code values at the nodes, [R, 3, M], without gradient."""
        return curve_values(self.theta.detach().cpu())

    def codes_of(self, log_exposure: Array) -> Array:
        """Codes [M, 3] of the first response at ln(E k) [M]."""
        x = self.rate * (log_exposure - self.middle)
        nodes, curves = self.nodes.double().numpy(), self.curves()[0].double().numpy()
        return np.stack([np.interp(x, nodes, curve) for curve in curves], -1)

    def _weighted(self, view: View) -> _Codes:
        """Weights of errors, the same for all shots of a pixel."""
        codes = _codes(view)
        target = _by_shot(codes.target()).numpy()
        bound = np.zeros(target.shape, bool)
        for ends in (codes.below, codes.above):
            if ends is not None:
                bound |= _by_shot(ends).numpy()
        response = self.of_camera[view.camera]
        slope = np.empty_like(target)
        for channel in range(3):
            curve, slopes = self._start[response, channel], self._slopes[response, channel]
            slope[:, channel] = np.interp(target[:, channel], curve, slopes)
        mean_slope = np.where(bound, 0, slope).mean(0).clip(LEAST_SLOPE)
        weight = (TYPICAL_SLOPE / mean_slope) ** np.float32(self.balance)
        return replace(codes, weight=torch.from_numpy(weight).to(torch.float32))

    def _expose(
        self,
        image: Tensor,
        view: View,
        scales: Sequence[float],
        factors: Tensor | None,
        curves: Tensor,
        *,
        leaky: bool,
    ) -> Tensor:
        """Codes of shots of these scales through curves such as `theta`, [shots, 3, H, W]."""
        falloff = self._prepared.array(view.sensor.falloff, image)
        light = torch.log(scattered(image, view.sensor.glare) * falloff[..., None] + self.epsilon)
        # In float64, where the normaliser and the scales cancel: another unit of light changes no bit.
        developed = np.outer(scales, view.sensor.white_balance)
        offset = torch.from_numpy(np.log(self.normaliser * developed) - self.middle)
        offset = offset.to(image, non_blocking=True)
        if factors is not None:
            offset = offset + factors.log()[:, None]
        x = self.rate * (light.movedim(2, 0)[None] + offset[..., None, None])
        values = curve_values(curves[self.of_camera[view.camera]]).to(image)
        nodes = self.nodes.to(image.dtype)
        channels = [apply_curve(x[:, channel], values[channel], nodes, leaky=leaky) for channel in range(3)]
        return torch.stack(channels, 1)


@dataclass
class Display(Observation):
    """Code values as they are, as 3DGS has them, without any idea of exposure.

    `k` is the exposure scale at which the display values are read as light, when radiance is asked for.
    developed: the calibration estimated the development of each photograph, its exposure and white balance.
    The scene then has the display values at `k`, above 1 where only darker photographs show them, and each
    photograph those times its own factors, falloff among them, to the `DISPLAY_POWER`.
    """

    response: Response
    k: float
    display_values = True
    developed: bool = False
    _prepared: Targets[_Codes] = field(default_factory=Targets, repr=False)
    _shades: dict[int, tuple[Array32, Array32]] = field(default_factory=dict, repr=False)

    def compare(
        self, image: Tensor, view: View, progress: float, factors: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """The image as every shot shows it, beside the photographs: [shots * 3, H, W]."""
        codes = self._prepared.of(view, lambda: _codes(view), image.device)
        shade, gains = self._shade_of(view), self._gains(view, [shot.k for shot in view.shots])
        if image.device.type == "cpu" and image.dtype == torch.float32:
            return photographed(image, shade, gains, codes.stored, codes.below, codes.above)
        target = codes.target()
        each = torch.from_numpy(gains).to(image, non_blocking=True)[:, None, None]
        if shade.size:
            each = self._prepared.array(shade, image)[..., None] * each
        prediction = (image[None] * each).movedim(3, 1).flatten(0, 1)
        return codes.bound(prediction, target), target

    def predict(self, image: Tensor, view: View, k: float, band: int | None = None) -> Tensor:
        """The image as the photograph shows it, within 0..1."""
        gains = torch.from_numpy(self._gains(view, [k])[0]).to(image)
        shade = torch.from_numpy(self._shade(view)).to(image)
        return (image * (shade[..., None] * gains if len(shade) else gains)).clamp(0.0, 1.0)

    def radiance(self, image: Tensor) -> Tensor:
        """The image through the inverse response, over `k`."""
        codes = image.detach().cpu().numpy()
        light = decode(codes.clip(0, 1), self.response) / np.float32(self.k)
        return torch.from_numpy(light * codes.clip(1) ** (1 / DISPLAY_POWER) if self.developed else light)

    def units(self, radiance: Tensor) -> Tensor:
        """Radiance [N, 3] as codes at `k`."""
        light = radiance.cpu().numpy() * np.float32(self.k)
        codes = encode(light, self.response)
        return torch.from_numpy(codes * light.clip(1) ** DISPLAY_POWER if self.developed else codes)

    def _gains(self, view: View, scales: Sequence[float]) -> Array32:
        """Gains of each shot's display values before its falloff, [shots, 3]."""
        developed = np.outer(scales, view.sensor.white_balance) / self.k
        return np.asarray(developed**DISPLAY_POWER if self.developed else np.ones_like(developed), np.float32)

    def _shade(self, view: View) -> Array32:
        """Falloff of display values, [H, W]; of size 0 where no photograph has its own."""
        if not self.developed:
            return np.empty((0, 0), np.float32)
        return np.asarray(view.sensor.falloff.astype(np.float64) ** DISPLAY_POWER, np.float32)

    def _shade_of(self, view: View) -> Array32:
        """The same, made once for all views that have the falloff in common."""
        falloff = view.sensor.falloff
        if id(falloff) not in self._shades:  # it is kept beside its shade, so that no other has its id
            self._shades[id(falloff)] = falloff, self._shade(view)
        return self._shades[id(falloff)][1]

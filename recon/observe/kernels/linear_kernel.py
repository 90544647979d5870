# mypy: allow-untyped-defs, allow-untyped-calls
"""Shots of linear light in their mu-law, and the gradient, in one pass over memory each, for the CPU.

Colour filter, falloff, exposure, mu-law and what saturation leaves open, of a row of the image at a time.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from imaging.arrays import Array32, Integers
from imaging.compute.jit import inlined, kernel
from imaging.compute.threads import share, take_number

ROWS = 8
"""Rows that a thread takes at a time."""
_ONE, _ZERO, _INFINITE = np.float32(1.0), np.float32(0.0), np.float32(np.inf)
_HALF = np.float32(0.5)
_HALF_ROOT = np.int32(0x3F3504F3)
"""The bits of sqrt(1/2): with them off, the exponent steps there."""
_LN2 = np.float32(np.log(2)), np.float32(np.log(2) - np.float64(np.float32(np.log(2))))
# ln(1 + f) = f - f^2 / 2 + f^3 P(f) for sqrt(1/2) <= 1 + f < sqrt(2): P as Cephes has it for float32.
_LOG = tuple(
    np.float32(c)
    for c in (
        7.0376836292e-2, -1.1514610310e-1, 1.1676998740e-1, -1.2420140846e-1, 1.4249322787e-1,
        -1.6668057665e-1, 2.0000714765e-1, -2.4999993993e-1, 3.3333331174e-1,
    )
)  # fmt: skip


@dataclass(frozen=True)
class Sites:
    """The sites of a tile: where each is, and what of the light's three channels reaches it.

    period: rows and columns of the tile. offsets int64 [P, 2]: row and column of each. weights float32
    [P, 3].
    """

    period: tuple[int, int]
    offsets: Integers
    weights: Array32


def recorded(
    image: Tensor,
    scales: Tensor,
    sites: Sites,
    falloff: Tensor,
    target: Tensor,
    saturated: Tensor | None,
    valid: Tensor | None,
    mu: float,
) -> Tensor:
    """The mu-law of J shots of an image, float32 [J, P, h, w], all on the CPU.

    Differentiable in the image and in the scales.

    Args:
        image: Linear light, float32 [H, W, 3]; H and W are multiples of the period of the tile.
        scales: Exposure scale of each shot, [J].
        sites: The P sites of the tile.
        falloff: Factors on the light at each sample, [P, h, w], or [1, h, w] for all sites alike.
        target: Recorded values in mu-law, [J, P, h, w].
        saturated: Mask [J, P, h, w] of the samples whose prediction above the target counts as it, without
            gradient; None: nowhere.
        valid: Mask [J, P, h, w] of the samples that count; elsewhere every prediction is the target, without
            gradient. None: all of them count.
        mu: Constant of the mu-law.

    Returns:
        The predicted values in mu-law.
    """
    result: Tensor = _Recorded.apply(image, scales, (sites, falloff, target, saturated, valid, mu))
    return result


class _Recorded(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, image: Tensor, scales: Tensor, constants: tuple[Any, ...]) -> Tensor:
        sites, falloff, target, saturated, valid, mu = constants
        light, prediction = torch.empty(target.shape[1:]), torch.empty(target.shape)
        masks = tuple(np.empty(0, bool) if m is None else m.numpy().ravel() for m in (saturated, valid))
        height, width = image.shape[:2]
        share(
            _forward, 2e-3 * target.numel(), height, width, image.detach().contiguous().numpy().ravel(),
            scales.detach().numpy(), *sites.period, sites.offsets, sites.weights,
            falloff.contiguous().numpy().ravel(), target.numpy().ravel(), *masks, np.float32(mu),
            np.float32(1 / np.log1p(mu)), light.numpy().ravel(), prediction.numpy().ravel(),
        )  # fmt: skip
        ctx.save_for_backward(scales, falloff, target, light, prediction)
        ctx.rest = sites, masks, mu, image.shape
        return prediction

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        scales, falloff, target, light, prediction = ctx.saved_tensors
        sites, masks, mu, shape = ctx.rest
        gradient = torch.empty(shape)
        # One sum a row of the image: no number of threads changes a bit.
        by_scale = np.zeros((shape[0] if ctx.needs_input_grad[1] else 0, len(scales)))
        share(
            _backward, 1e-3 * target.numel(), *shape[:2], scales.detach().numpy(), *sites.period,
            sites.offsets, sites.weights, falloff.contiguous().numpy().ravel(), target.numpy().ravel(),
            *masks, np.float32(mu), np.float32(mu / np.log1p(mu)), light.numpy().ravel(),
            prediction.detach().numpy().ravel(),
            gradients[0].detach().contiguous().numpy().ravel(), gradient.numpy().ravel(), by_scale,
        )  # fmt: skip
        turned = torch.from_numpy(by_scale.sum(0).astype(np.float32)) if len(by_scale) else None
        return gradient, turned, None


@inlined
def _logarithms(bend, bits, out):
    """Natural logarithms of rows of positive normal numbers; bits: their bits, which are lost.

    Infinite and NaN stay what they are.
    """
    a, b, c, d, e, f, g, h, i = _LOG
    high, low = _LN2
    for x in range(len(out)):
        power = (bits[x] - _HALF_ROOT) >> 23
        bits[x] = bits[x] - (power << 23)
        out[x] = np.float32(power)
    for x in range(len(out)):
        m, power = bend[x] - _ONE, out[x]
        z = m * m
        p = ((((((((a * m + b) * m + c) * m + d) * m + e) * m + f) * m + g) * m + h) * m + i) * m * z
        out[x] = (m + (p - _HALF * z + power * low)) + power * high


@kernel
def _forward(
    counter, height, width, image, scales, rows, columns, offsets, weights, falloff, target, saturated, valid,
    mu, unit, light, prediction,
):  # fmt: skip
    """Fill light [P, h, w] before the exposure, and the prediction."""
    down, across = height // rows, width // columns
    size, task = down * across, take_number(counter)
    bend, value = np.empty(across, np.float32), np.empty(across, np.float32)
    bits = bend.view(np.int32)
    while task * ROWS < height:
        for row in range(task * ROWS, min((task + 1) * ROWS, height)):
            for site in range(len(offsets)):
                if offsets[site, 0] != row % rows:
                    continue
                start = site * size + row // rows * across
                lit, shade = light[start : start + across], falloff[start % len(falloff) :][:across]
                line = image[3 * (row * width + offsets[site, 1]) : 3 * (row + 1) * width]
                red, green, blue = weights[site]
                step = 3 * columns
                for x in range(across):
                    i = x * step
                    lit[x] = (line[i] * red + line[i + 1] * green + line[i + 2] * blue) * shade[x]
                for shot in range(len(scales)):
                    at, scale = shot * len(offsets) * size + start, scales[shot]
                    goal, out = target[at : at + across], prediction[at : at + across]
                    for x in range(across):
                        bend[x] = abs(lit[x] * scale) * mu + _ONE
                        out[x] = bend[x]
                    _logarithms(bend, bits, value)
                    for x in range(across):
                        v = value[x] * unit if out[x] < _INFINITE else out[x]
                        out[x] = -v if lit[x] * scale < _ZERO else v
                    if len(saturated):
                        open_up = saturated[at : at + across]
                        for x in range(across):
                            v, limit = out[x], goal[x]
                            out[x] = limit if open_up[x] & (v > limit) else v
                    if len(valid):
                        counts = valid[at : at + across]
                        for x in range(across):
                            v, same = out[x], goal[x]
                            out[x] = v if counts[x] else same
        task = take_number(counter)


@kernel
def _backward(
    counter, height, width, scales, rows, columns, offsets, weights, falloff, target, saturated, valid, mu,
    rise, light, prediction, outer, gradient, by_scale,
):  # fmt: skip
    """Fill d loss / d image [H, W, 3], and that of the scales, by rows of the image, by_scale [H, J]."""
    down, across = height // rows, width // columns
    size, task = down * across, take_number(counter)
    slope, total = np.empty(across, np.float32), np.empty(across, np.float32)
    while task * ROWS < height:
        for row in range(task * ROWS, min((task + 1) * ROWS, height)):
            gradient[3 * row * width : 3 * (row + 1) * width] = _ZERO
            for site in range(len(offsets)):
                if offsets[site, 0] != row % rows:
                    continue
                start = site * size + row // rows * across
                lit, shade = light[start : start + across], falloff[start % len(falloff) :][:across]
                total[:] = _ZERO
                for shot in range(len(scales)):
                    at, scale = shot * len(offsets) * size + start, scales[shot]
                    pull = outer[at : at + across]
                    for x in range(across):
                        slope[x] = pull[x] * rise / (abs(lit[x] * scale) * mu + _ONE)
                    if len(saturated):
                        open_up, goal = saturated[at : at + across], target[at : at + across]
                        shown = prediction[at : at + across]
                        for x in range(across):
                            v, stops = slope[x], shown[x] >= goal[x]
                            slope[x] = _ZERO if open_up[x] & stops else v
                    if len(valid):
                        counts = valid[at : at + across]
                        for x in range(across):
                            v = slope[x]
                            slope[x] = v if counts[x] else _ZERO
                    if len(by_scale):
                        for x in range(across):
                            by_scale[row, shot] += np.float64(slope[x]) * np.float64(lit[x])
                    for x in range(across):
                        total[x] += slope[x] * scale
                line = gradient[3 * (row * width + offsets[site, 1]) : 3 * (row + 1) * width]
                red, green, blue = weights[site]
                step = 3 * columns
                for x in range(across):
                    i, g = x * step, total[x] * shade[x]
                    line[i] += g * red
                    line[i + 1] += g * green
                    line[i + 2] += g * blue
        task = take_number(counter)

"""Losses between a predicted image and a photograph: mu-law, L1 and SSIM on planes."""

import math
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from recon.observe.losses.ssim import photometric_loss


class _MuLaw(torch.autograd.Function):
    """mu-law of `signal * scales`, cut off at `ceiling`, in few passes over memory."""

    @staticmethod
    def forward(ctx: Any, signal: Tensor, scales: Tensor, ceiling: Tensor | None, mu: float) -> Tensor:
        exposed = signal * scales
        bend = exposed.abs().mul_(mu).add_(1)
        value = bend.log().mul_(1 / math.log1p(mu)).copysign_(exposed)
        below = None
        if ceiling is not None:
            below = value <= ceiling
            value = torch.minimum(value, ceiling, out=value)
        ctx.mu = mu
        ctx.save_for_backward(bend, scales, below, signal if ctx.needs_input_grad[1] else None)
        return value

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        bend, scales, below, signal = ctx.saved_tensors
        slope = gradients[0] * scales
        slope.mul_(ctx.mu / math.log1p(ctx.mu)).div_(bend)
        if below is not None:
            slope.mul_(below)
        if signal is None:
            return slope.sum(0), None, None, None
        rest = tuple(range(1, slope.ndim))
        return slope.sum(0), (slope * signal).sum(rest, keepdim=True) / scales, None, None


def mu_law(signal: Tensor, mu: float) -> Tensor:
    """Odd mu-law of a signal of any shape: `sign(x) log(1 + mu |x|) / log(1 + mu)`.

    Odd, since black-subtracted RAW goes below zero in the dark; its slope at 0 is that of both sides,
    so that a Gaussian that shows exactly nothing still has a gradient. Differentiable everywhere.
    """
    scale = torch.ones(1, dtype=signal.dtype).reshape([1] * (signal.ndim + 1))
    return exposed_mu_law(signal, scale, None, mu)[0]


def exposed_mu_law(signal: Tensor, scales: Tensor, ceiling: Tensor | None, mu: float) -> Tensor:
    """Odd mu-law of one signal at several exposures.

    Differentiable in the signal and in the scales.

    Args:
        signal: Linear signal of any shape [...].
        scales: Exposure scale of each shot, [J, 1, ...], with as many dimensions as the result.
        ceiling: Values in mu-law, [J, ...], above which predictions count as them and have no gradient;
            infinite where there is no limit; None: no limit anywhere.
        mu: Constant of the mu-law.

    Returns:
        The mu-law of `signal * scales`, [J, ...].
    """
    result: Tensor = _MuLaw.apply(signal, scales, ceiling, mu)  # type: ignore[no-untyped-call]
    return result


@dataclass(frozen=True)
class Photometric:
    """`(1 - w) L1 + w (1 - SSIM)` of planes [P, H, W] that lie in about 0..1.

    NH-3DGS prints w = 0.8 (arXiv 2511.12895), 3DGS 0.2 (arXiv 2308.04079).
    """

    ssim_weight: float = 0.05

    def __call__(self, prediction: Tensor, target: Tensor) -> Tensor:
        """The loss, a scalar, float32, differentiable in the prediction."""
        return photometric_loss(prediction, target, self.ssim_weight)

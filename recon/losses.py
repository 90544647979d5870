"""How far a predicted image is from a photograph: mu-law, L1 and SSIM on planes."""

import math
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from recon.ssim import photometric_loss

MU = 5000.0


class _MuLaw(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, signal: Tensor) -> Tensor:
        ctx.save_for_backward(signal)
        curve: Tensor = torch.log1p(MU * signal.abs()).copysign_(signal).mul_(1 / math.log1p(MU))
        return curve

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> Tensor:
        (signal,) = ctx.saved_tensors
        slope: Tensor = gradients[0] * (MU / math.log1p(MU)) / (1 + MU * signal.abs())
        return slope


def mu_law(signal: Tensor) -> Tensor:
    """Odd mu-law of a signal of any shape: `sign(x) log(1 + mu |x|) / log(1 + mu)`, mu = 5000.

    Odd, since black-subtracted RAW goes below zero in the dark; its slope at 0 is that of both sides,
    so that a Gaussian that shows exactly nothing still has a gradient. Differentiable everywhere.
    """
    result: Tensor = _MuLaw.apply(signal)  # type: ignore[no-untyped-call]
    return result


def at_most(prediction: Tensor, target: Tensor, where: Tensor) -> Tensor:
    """The prediction, but not above the target at saturated photosites (`where`), which say no more.

    There an over-prediction counts as right and has no gradient; an under-prediction counts in full.
    This is what the sensor does to light, so SSIM sees the two images alike. All of one shape.
    """
    return torch.where(where, torch.minimum(prediction, target), prediction)


@dataclass(frozen=True)
class Photometric:
    """`(1 - w) L1 + w (1 - SSIM)` of planes [P, H, W] that lie in about 0..1.

    NH-3DGS prints w = 0.8 (arXiv 2511.12895), 3DGS 0.2 (arXiv 2308.04079).
    """

    ssim_weight: float = 0.05

    def __call__(self, prediction: Tensor, target: Tensor) -> Tensor:
        """The loss, a scalar, float32, differentiable in the prediction."""
        return photometric_loss(prediction, target, self.ssim_weight)

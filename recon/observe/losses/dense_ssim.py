"""L1 and SSIM of planes with their gradient in plain torch operations, for devices that Numba does not reach.

In few operations, since each is a kernel to be launched. Sum s = x + y and difference d = x - y of two planes
stand for them: with a, v of each its squared mean and its variance, SSIM = (a_s - a_d + 2 C1)
(v_s - v_d + 2 C2) / ((a_s + a_d + 2 C1) (v_s + v_d + 2 C2)), whose factors and slopes come in pairs. Where x
equals y, the slope is exactly 0.
"""

from functools import lru_cache
from typing import Any

import torch
from torch import Tensor
from torch.nn.functional import conv2d

from imaging.metrics import SSIM_C1, SSIM_C2, SSIM_RADIUS, ssim_taps


class _Photometric(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, prediction: Tensor, target: Tensor, weight: float, keep: bool) -> Tensor:
        value, gradient = _compared(prediction, target, weight, keep)
        ctx.save_for_backward(gradient)
        return value

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        (gradient,) = ctx.saved_tensors
        return gradient * gradients[0], None, None, None


def dense_photometric_loss(prediction: Tensor, target: Tensor, ssim_weight: float) -> Tensor:
    """Loss as `recon.observe.losses.ssim.photometric_loss`, of float planes [P, H, W] on any device."""
    keep = torch.is_grad_enabled() and prediction.requires_grad
    loss: Tensor = _Photometric.apply(prediction, target, ssim_weight, keep)  # type: ignore[no-untyped-call]
    return loss


def _compared(x: Tensor, y: Tensor, weight: float, keep: bool) -> tuple[Tensor, Tensor | None]:
    """The loss and its gradient by x, [P, H, W], if that is to be kept."""
    pair = x.new_empty(len(x), 4, *x.shape[1:])
    s, d = pair[:, 0], pair[:, 1]
    torch.add(x, y, out=s)
    torch.sub(x, y, out=d)
    torch.square(pair[:, :2], out=pair[:, 2:])
    like, slopes = _structure(pair, keep)
    value = torch.lerp(d.abs().mean(), 1 - like, weight)
    if slopes is None:
        return value, None
    by_means, by_d, by_s = _filtered(slopes).unbind(1)
    gradient = by_means.addcmul(s, by_s).addcmul_(d, by_d, value=-1).mul_(-4 * weight / x.numel())
    return value, gradient.add_(d.sgn(), alpha=(1 - weight) / x.numel())


def _structure(pair: Tensor, keep: bool) -> tuple[Tensor, Tensor | None]:
    """Mean SSIM from s, d, s^2 and d^2, [P, 4, H, W], and its slopes, [P, 3, H, W], if they are kept.

    A quarter of that by x through both means; then half of that by the mean of d^2, negative, and of that by
    the mean of s^2.
    """
    means, squares = _filtered(pair).chunk(2, dim=1)
    # [a or v, of s or d]; the constants go with s, which has the same sign in all factors.
    terms = torch.stack([means.square(), squares], dim=1)
    terms[:, 1].sub_(terms[:, 0])
    terms[:, 0, 0].add_(2 * SSIM_C1)
    terms[:, 1, 0].add_(2 * SSIM_C2)
    above, below = terms[:, :, 0] - terms[:, :, 1], terms[:, :, 0] + terms[:, :, 1]
    below[:, 1].clamp_min_(2 * SSIM_C2)
    ratios = above / (below[:, :1] * below[:, 1:])
    like = (ratios[:, 0] * above[:, 1]).mean()
    if not keep:
        return like, None
    slopes = pair.new_empty(len(pair), 3, *pair.shape[2:])
    by_squares = slopes[:, 1:]
    torch.mul(terms[:, 1], (ratios[:, 0] / below[:, 1])[:, None], out=by_squares)
    rest = torch.addcmul(by_squares, terms[:, 0], (ratios[:, 1] / below[:, 0])[:, None], value=-1)
    torch.mul(means[:, 1], rest[:, 0], out=slopes[:, 0])
    slopes[:, 0].addcmul_(means[:, 0], rest[:, 1], value=-1)
    return like, slopes


def _filtered(maps: Tensor) -> Tensor:
    """Weighted means of [P, C, H, W] over the window, with zeros outside."""
    taps = _taps(maps.dtype, maps.device)
    rows = conv2d(maps.flatten(0, 1)[:, None], taps[None, None, :, None], padding=(SSIM_RADIUS, 0))
    return conv2d(rows, taps[None, None, None, :], padding=(0, SSIM_RADIUS)).view_as(maps)


@lru_cache(maxsize=4)
def _taps(dtype: torch.dtype, device: torch.device) -> Tensor:
    """The Gaussian window on a device, [11]."""
    return torch.as_tensor(ssim_taps(), dtype=dtype, device=device)

"""L1 and SSIM of planes in plain torch operations, for devices that Numba does not reach."""

from functools import lru_cache

import torch
from torch import Tensor
from torch.nn.functional import conv2d

from imaging.metrics import SSIM_C1, SSIM_C2, SSIM_RADIUS, ssim_taps


def dense_photometric_loss(prediction: Tensor, target: Tensor, ssim_weight: float) -> Tensor:
    """Loss as `recon.observe.ssim.photometric_loss`, of float planes [P, H, W] on any device, by autograd."""
    taps = _taps(prediction.dtype, prediction.device)
    maps = torch.stack([prediction, target, prediction.square() + target.square(), prediction * target], 1)
    maps = maps.reshape(-1, 1, *prediction.shape[1:])
    maps = conv2d(maps, taps[None, None, :, None], padding=(SSIM_RADIUS, 0))
    maps = conv2d(maps, taps[None, None, None, :], padding=(0, SSIM_RADIUS))
    mx, my, squares, product = maps.reshape(len(prediction), 4, *prediction.shape[1:]).unbind(1)
    means, both = mx * my, mx.square() + my.square()
    top = (2 * means + SSIM_C1) * (2 * (product - means) + SSIM_C2)
    ssim = top / ((both + SSIM_C1) * ((squares - both).clamp_min(0) + SSIM_C2))
    near = (prediction - target).abs().mean()
    return (1 - ssim_weight) * near + ssim_weight * (1 - ssim.mean())


@lru_cache(maxsize=4)
def _taps(dtype: torch.dtype, device: torch.device) -> Tensor:
    """The Gaussian window on a device, [11]."""
    return torch.as_tensor(ssim_taps(), dtype=dtype, device=device)

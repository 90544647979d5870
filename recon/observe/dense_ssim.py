"""L1 and SSIM of planes in plain torch operations, for devices that Numba does not reach."""

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor
from torch.nn.functional import conv2d

RADIUS = 5
C1, C2 = 0.01**2, 0.03**2


def window() -> npt.NDArray[np.float64]:
    """The 11 taps, summing to 1."""
    taps = np.exp(-0.5 * (np.arange(-RADIUS, RADIUS + 1) / 1.5) ** 2)
    return np.asarray(taps / taps.sum())


def dense_photometric_loss(prediction: Tensor, target: Tensor, ssim_weight: float) -> Tensor:
    """As `recon.observe.ssim.photometric_loss`, of float planes [P, H, W] on any device, by autograd."""
    taps = torch.as_tensor(window(), dtype=prediction.dtype, device=prediction.device)
    maps = torch.stack([prediction, target, prediction.square() + target.square(), prediction * target], 1)
    maps = maps.reshape(-1, 1, *prediction.shape[1:])
    maps = conv2d(maps, taps[None, None, :, None], padding=(RADIUS, 0))
    maps = conv2d(maps, taps[None, None, None, :], padding=(0, RADIUS))
    mx, my, squares, product = maps.reshape(len(prediction), 4, *prediction.shape[1:]).unbind(1)
    means, both = mx * my, mx.square() + my.square()
    top = (2 * means + C1) * (2 * (product - means) + C2)
    ssim = top / ((both + C1) * ((squares - both).clamp_min(0) + C2))
    near = (prediction - target).abs().mean()
    return (1 - ssim_weight) * near + ssim_weight * (1 - ssim.mean())

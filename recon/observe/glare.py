"""Veiling glare: a share of the light that lens and sensor scatter over the whole picture.

After Talvala et al., "Veiling glare in high dynamic range imaging" (SIGGRAPH 2007): the picture of a point is
the point and a wide halo, heavy-tailed. One number a camera says how much of the light is in the halo.
"""

from functools import lru_cache

import torch
from scipy.fft import next_fast_len
from torch import Tensor
from torch.nn.functional import adaptive_avg_pool2d, interpolate

RADIUS = 0.02
"""Radius as a share of the image's diagonal: the halo falls off as `1 / (1 + (r / RADIUS)^2)`."""
CELLS = 100
"""Along the diagonal of the image in which the halo is reckoned; it has no detail that is finer."""


def scattered(image: Tensor, share: Tensor | float) -> Tensor:
    """Light [H, W, C] of which `share`, 0..1, is spread: differentiable in both.

    What is beyond the picture is taken to be as what is within, as far as the halo reaches: even light stays.
    """
    if isinstance(share, float) and share == 0.0:
        return image
    return torch.lerp(image, spread(image), torch.as_tensor(share).to(image, non_blocking=True))


def spread(image: Tensor) -> Tensor:
    """The image [H, W, C] behind the halo alone."""
    height, width = image.shape[:2]
    scale = min(1.0, CELLS / (height**2 + width**2) ** 0.5)
    rows, columns = max(1, round(scale * height)), max(1, round(scale * width))
    spectrum, weight = _halo(rows, columns, image.dtype, image.device)
    small = adaptive_avg_pool2d(image.movedim(2, 0)[None], (rows, columns))
    size = _padded(rows), _padded(columns)
    halo = torch.fft.irfft2(torch.fft.rfft2(small, s=size) * spectrum, s=size)[..., :rows, :columns] / weight
    return interpolate(halo, size=(height, width), mode="bilinear", align_corners=False)[0].movedim(0, 2)


def _padded(side: int) -> int:
    """Return the cells of a side as it is transformed: room for the halo of its ends, and factors that are
    fast.
    """
    return int(next_fast_len(2 * side, real=True))


@lru_cache(maxsize=16)
def _halo(rows: int, columns: int, dtype: torch.dtype, device: torch.device) -> tuple[Tensor, Tensor]:
    """The transform of the kernel, padded, and what of it is within the picture, [rows, columns]."""
    y, x = (
        torch.minimum(torch.arange(size), size - torch.arange(size)).double()
        for size in (_padded(rows), _padded(columns))
    )
    square = (y[:, None] ** 2 + x[None] ** 2) / (rows**2 + columns**2)
    kernel = 1 / (1 + square / RADIUS**2)
    spectrum = torch.fft.rfft2(kernel)
    ones = torch.zeros(kernel.shape, dtype=torch.float64)
    ones[:rows, :columns] = 1
    weight = torch.fft.irfft2(torch.fft.rfft2(ones) * spectrum, s=ones.shape)[:rows, :columns]
    complex_of = torch.complex64 if dtype == torch.float32 else torch.complex128
    return spectrum.to(device, complex_of), weight.to(device, dtype)

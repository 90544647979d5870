"""Mosaics that are not Bayer's in colour: the densest channel along edges, others by their difference to it.

Normalised convolution (Knutsson and Westin, CVPR 1993) with Gaussians that the structure tensor turns along
edges, as in kernel regression (Takeda, Farsiu and Milanfar, IEEE TIP 16(2), 2007); then, as in most
demosaicking, colour differences, which are smoother than colours. It takes any table, since weights go where
photosites are.
"""

import cv2
import numpy as np
import numpy.typing as npt

from imaging.arrays import Array32, Bytes, Floats

DIRECTIONS = 8
ALONG, ACROSS, REACH = 1.2, 0.45, 4
"""px: deviations of the Gaussian along an edge and across it, and where it ends."""
GRADIENT, TENSOR = 0.6, 1.2
"""px: deviations of the Gaussians that gradients are taken under, and their products are averaged by."""
DIFFERENCE = 1.6
"""px: deviation of the Gaussian that colour differences are averaged by."""
DOUBT = 0.5
"""Standard error of a difference of colours over how uneven it is around; of the densest channel it is how
far edges and tents disagree."""
_LITTLE = 1e-6
"""Weight of a wide window, which decides where the narrow one has no photosite."""


def interpolated(
    code: Array32, sites: Bytes, start: Array32, densest: int, noise: Array32 | None
) -> tuple[Array32, Array32 | None]:
    """Channels [H, W, channels] of a code [H, W] and, where its noise (variance) is known, their variance.

    sites: channel of each photosite, which keeps its value. start: the channels as tents interpolate them.
    """
    masks = [(sites == channel).astype(np.float32) for channel in range(start.shape[2])]
    way, windows = _edges(start), _windows()
    here = masks[densest] > 0
    main = np.where(here, code, _steered(code, masks[densest], way, windows))
    apart = code - main
    planes, smooth = [], {}
    for channel, mask in enumerate(masks):
        weight = np.maximum(_blurred(mask), _LITTLE)
        smooth[channel] = _blurred(apart * mask) / weight
        other = main if channel == densest else main + smooth[channel]
        planes.append(np.where(mask > 0, code, other))
    if noise is None:
        return np.stack(planes, axis=-1), None
    square = np.square(windows)
    own_noise = np.where(here, noise, _steered_variance(noise, masks[densest], way, windows, square))
    off = np.where(here, 0, np.square(main - start[..., densest]))
    missing = np.where(here, 0, 1)
    doubt = _blurred(off) - _blurred(own_noise * missing)
    doubt = missing * np.maximum(doubt / np.maximum(_blurred(missing), _LITTLE), 0)
    variances = []
    for channel, mask in enumerate(masks):
        spread = own_noise + doubt
        if channel != densest:
            weight = np.maximum(_blurred(mask), _LITTLE)
            mean = _blurred((noise + own_noise) * mask) / weight
            uneven = _blurred(np.square(apart) * mask) / weight - np.square(smooth[channel]) - mean
            # So many photosites of the channel have a say that their noise counts by so much less.
            few = 1 / np.maximum(4 * np.pi * DIFFERENCE**2 * weight, 1)
            spread = spread + few * mean + np.square(DOUBT) * np.maximum(uneven, 0)
        variances.append(np.where(mask > 0, noise, spread))
    return np.stack(planes, axis=-1), np.stack(variances, axis=-1).astype(np.float32)


def _edges(planes: Array32) -> npt.NDArray[np.intp]:
    """Return which of the directions runs along the edge at each pixel, [H, W]."""
    tensor = np.zeros((3, *planes.shape[:2]), np.float32)
    for channel in range(planes.shape[2]):
        smooth = _blurred(planes[..., channel], GRADIENT)
        x, y = cv2.Scharr(smooth, cv2.CV_32F, 1, 0), cv2.Scharr(smooth, cv2.CV_32F, 0, 1)
        tensor += np.stack([x * x, x * y, y * y])
    xx, xy, yy = (_blurred(product, TENSOR) for product in tensor)
    angle = 0.5 * np.arctan2(2 * xy, xx - yy) + np.pi / 2
    return np.asarray(np.rint(angle / np.pi * DIRECTIONS).astype(np.intp) % DIRECTIONS)


def _windows() -> Array32:
    """Weights of each direction, [DIRECTIONS, n, n]."""
    y, x = np.mgrid[-REACH : REACH + 1, -REACH : REACH + 1]
    angles = np.pi * np.arange(DIRECTIONS)[:, None, None] / DIRECTIONS
    along, across = x * np.cos(angles) + y * np.sin(angles), y * np.cos(angles) - x * np.sin(angles)
    return np.asarray(np.exp(-0.5 * ((along / ALONG) ** 2 + (across / ACROSS) ** 2)) + _LITTLE, np.float32)


def _steered(values: Array32, mask: Array32, way: npt.NDArray[np.intp], windows: Array32) -> Array32:
    """Mean of the values where the mask is 1, weighted along the edge at each pixel."""
    out = np.zeros_like(values)
    for direction, window in enumerate(windows):
        here = way == direction
        total, weight = _filtered(values * mask, window), _filtered(mask, window)
        out[here] = (total / np.maximum(weight, _LITTLE))[here]
    return out


def _steered_variance(
    noise: Array32, mask: Array32, way: npt.NDArray[np.intp], windows: Array32, squares: Array32
) -> Array32:
    """Variance of what `_steered` gives of values of such noise."""
    out = np.zeros_like(noise)
    for direction, (window, square) in enumerate(zip(windows, squares, strict=True)):
        here = way == direction
        total, weight = _filtered(noise * mask, square), _filtered(mask, window)
        out[here] = (total / np.maximum(np.square(weight), _LITTLE**2))[here]
    return out


def _filtered(values: Floats, window: Array32) -> Array32:
    return np.asarray(
        cv2.filter2D(np.ascontiguousarray(values, np.float32), -1, window, borderType=cv2.BORDER_REFLECT_101)
    )


def _blurred(values: npt.NDArray[np.generic], deviation: float = DIFFERENCE) -> Array32:
    size = 2 * round(4 * deviation) + 1
    return np.asarray(
        cv2.GaussianBlur(
            np.ascontiguousarray(values, np.float32), (size, size), deviation,
            borderType=cv2.BORDER_REFLECT_101,
        )
    )  # fmt: skip

"""Demosaicing along edges, in a logarithmic code, with the standard deviation of what comes of it.

Menon, Andriani and Calvagno, "Demosaicing With Directional Filtering and a posteriori Decision" (IEEE
Transactions on Image Processing 16(1), 2007): green is interpolated along rows and along columns, each pixel
takes the direction in which colour changes less, and red and blue follow green. Two things are different. It
works on `asinh(light / toe)`, since over the range of a merged bracket the ratios of colours are smooth and
not their differences; and green stays within the range of its four neighbours, since the code would make
much of an overshoot at a lamp. `steered` has other tables than Bayer's, by the same code.
"""

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np

from imaging.arrays import AnyArray, Array, Array32, Bytes, Floats, Mask
from imaging.compute.threads import share_pieces
from imaging.demosaicking.directional import colours, greens, put_light
from imaging.demosaicking.steered import interpolated
from imaging.sensor.cfa import Cfa, bilinear, bilinear_variance, mosaic

TOE_OF_LIGHT, TOE_OF_NOISE = 1 / 16, 16.0
"""The code turns linear below this share of the median light, or this many times the least noise."""
REACH = 2
"""px from a photosite without a value at which the stand-in for it still counts."""
ROWS, HALO = 512, 16
"""Rows at a time, which bounds the memory, and rows beside them that have a say in their values."""
DOUBT, COLOUR_DOUBT = 0.57, 2.1
"""Standard error of interpolation over how far rows and columns disagree, and over how uneven colour is along
rows or along columns, whichever is less: along an edge of two colours it is even, in foliage nowhere. On
path-traced light the squared error is 0.6 to 1.9 of the variance however much colour changes, on that of the
demo and the gallery 0.6 to 1.4."""
NOISE_SHARE = 0.7
"""Share of the photosites' noise that remains in the unevenness of interpolated colour."""

QUARTER = 0.3186
"""A quarter of a normal distribution of deviation 1 lies within this of its mean."""

_HALF = np.array([[0.5, 0.0, 0.5]], np.float32)
_CURVE = np.array([[-0.25, 0.0, 0.5, 0.0, -0.25]], np.float32)
_WINDOW, _NEAR = (5, 5), (3, 3)
"""px over which the noise of a channel is averaged for its neighbours, and signs of a wrong guess are."""


@dataclass(frozen=True, eq=False)
class Demosaicked:
    """rgb: float32 [H, W, channels], 0 where not known. known: bool, sigma: float32 or None, of that shape.

    sigma holds the noise of the photosites and a standard error of the interpolation; infinite near a
    photosite whose own is, NaN where nothing is known. Neighbours share photosites, so their errors are
    correlated over some 5 px.
    """

    rgb: Array32
    known: Mask
    sigma: Array32 | None


def demosaic(
    image: Floats,
    cfa: Cfa,
    valid: Mask | None = None,
    sigma: Floats | None = None,
    *,
    spread: bool = True,
) -> Demosaicked:
    """Colour at every photosite of a linear mosaic; recorded values stay as they are.

    Args:
        image: Mosaic [H, W], linear, of any scale.
        cfa: Colour of its photosites.
        valid: Photosites that have a value, [H, W]; those next to one without are interpolated bilinearly
            from what is there. None: all that are finite.
        sigma: Standard deviation of each photosite, [H, W], in the unit of the image, infinite for a bound.
        spread: True if the standard deviation of the result is wanted, which takes as long as the result.

    Returns:
        The colour [H, W, channels], where it is known, and its standard deviation, if `sigma` is known and it
        is wanted.
    """
    trusted = np.isfinite(image) if valid is None else valid & np.isfinite(image)
    variance: Array | None = None
    if cfa.bayer and trusted.all() and min(image.shape) > 1:  # what is not recorded is found along edges
        known = np.ones((*image.shape, 3), bool)
        rgb = _recorded(image, cfa).astype(np.float32)
        if sigma is not None and spread:
            variance = _recorded(np.square(sigma, dtype=np.float64), cfa)
    else:
        rgb, known = bilinear(image, cfa, trusted)
        if sigma is not None and spread:
            variance = bilinear_variance(np.square(sigma, dtype=np.float64), cfa, trusted)
    if trusted.any() and not cfa.mono:
        filled = image.astype(np.float32)
        if not trusted.all():
            filled = np.where(trusted, filled, _stand_in(image, trusted) if cfa.bayer else mosaic(rgb, cfa))
        toe = _toe(filled, sigma, cfa)
        near = cv2.dilate((~trusted).astype(np.uint8), np.ones((2 * REACH + 1,) * 2, np.uint8)) > 0
        channels, start = cfa.channels(*image.shape), None if cfa.bayer else rgb.copy()

        def strip(top: int, end: int) -> None:
            _strip(top, filled, sigma, toe, channels, near, rgb, variance, start, cfa.densest, cfa.cell)

        share_pieces(image.shape[0], ROWS, strip)
        for channel in range(len(cfa.letters)):
            # Beside a lamp red and blue may overshoot, which would set the scale of the scene.
            recorded = filled[trusted & (channels == channel)]
            if recorded.size:
                rgb[..., channel].clip(recorded.min(), recorded.max(), out=rgb[..., channel])
        if not known.all():
            rgb[~known] = 0
    deviation = None if variance is None else np.sqrt(variance).astype(np.float32)
    return Demosaicked(rgb, known, deviation)


def _recorded(values: Floats, cfa: Cfa) -> AnyArray:
    """Scatter each photosite's value into its own channel, [H, W, channels], with 0 in the others."""
    planes = np.zeros((*values.shape, len(cfa.letters)), values.dtype)
    (height, width), pattern = cfa.period, cfa.channels(*cfa.period)
    for (row, column), channel in np.ndenumerate(pattern):
        planes[row::height, column::width, channel] = values[row::height, column::width]
    return planes


def _strip(
    top: int,
    light: Array32,
    sigma: Floats | None,
    toe: float,
    channels: Bytes,
    near: Mask,
    rgb: Array32,
    spread: Array | None,
    start: Array32 | None,
    densest: int,
    cell: int,
) -> None:
    """Put ROWS rows from `top` on into `rgb` and `spread` (variance), but where `near` says so.

    start: the channels by tents, of tables that are not Bayer's; densest: their channel with most photosites.
    cell: of the table; so near a photosite without a value of its own nothing is measured.
    """
    first = max(top - HALO, 0)
    window, rows = slice(first, top + ROWS + HALO), slice(top, min(top + ROWS, len(light)))
    inner = slice(top - first, top - first + rows.stop - rows.start)
    letters = channels[window]
    code = np.arcsinh(light[window] / np.float32(toe))
    bound, noise = None, None
    if sigma is not None and spread is not None:
        bound = ~np.isfinite(sigma[window])
        slope = toe * np.sqrt(1 + np.square(np.sinh(code)))
        noise = np.where(bound, 0, np.square(np.where(bound, 0, sigma[window]) / slope)).astype(np.float32)
    if start is None:
        horizontal, disagreement, green = greens(code, letters)
        coded = colours(code, letters, horizontal, green)
        made: Floats | None
        made = (
            None if noise is None else _interpolated_variance(noise, letters, horizontal, disagreement, coded)
        )
    else:
        coded, made = interpolated(code, letters, np.arcsinh(start[window] / np.float32(toe)), densest, noise)
    coded = np.ascontiguousarray(coded[inner])
    put_light(coded, np.float32(toe), channels[rows], near[rows], rgb[rows])
    if spread is None or made is None or bound is None:
        return
    variance = made[inner].astype(np.float64) * np.square(toe * np.cosh(coded))
    reached = cv2.dilate(bound.astype(np.uint8), np.ones((2 * cell - 1,) * 2, np.uint8))[inner] > 0
    variance[reached] = np.inf
    sites = np.arange(rgb.shape[2]) == letters[inner][..., None]
    np.copyto(spread[rows], variance, where=~(near[rows][..., None] | sites))


def _interpolated_variance(
    noise: Array32, sites: Bytes, horizontal: Mask, disagreement: Array32, planes: Array32
) -> Array:
    """Variance [H, W, 3] of the code: the noise of the photosites, and what interpolation may miss."""
    mean = [
        cv2.blur(np.where(sites == channel, noise, 0), _WINDOW)
        / np.maximum(cv2.blur((sites == channel).astype(np.float32), _WINDOW), 1e-6)
        for channel in range(3)
    ]
    there = (sites != 1).astype(np.float32)
    expected = mean[1] + 0.25 * np.where(sites == 0, mean[0], mean[2])
    apart = cv2.blur((np.square(disagreement) - expected) * there, _NEAR)
    doubt = np.maximum(apart / np.maximum(cv2.blur(there, _NEAR), 1e-6), 0)
    shades = (planes[..., 0] - planes[..., 1], planes[..., 2] - planes[..., 1])
    uneven = [
        sum(cv2.blur(np.square(shade), line) - np.square(cv2.blur(shade, line)) for shade in shades)
        for line in ((_WINDOW[0], 1), (1, _WINDOW[0]))
    ]
    colour = np.maximum(np.minimum(*uneven) - NOISE_SHARE * np.sum(mean, axis=0), 0)
    doubt = DOUBT**2 * doubt + COLOUR_DOUBT**2 * colour
    case = np.where(horizontal, 0, 4) + _kinds(sites)
    shares = _shares().reshape(8, 3, 3).astype(np.float32)
    made_of = [doubt + sum(shares[:, made, of][case] * mean[of] for of in range(3)) for made in range(3)]
    return np.stack(made_of, axis=-1).astype(np.float64)


def _kinds(sites: Bytes) -> Bytes:
    """0 red, 1 green in a row with red, 2 green in a row with blue, 3 blue."""
    with_red = (sites == 0).any(1, keepdims=True)
    return np.where(sites == 0, 0, np.where(sites == 2, 3, np.where(with_red, 1, 2))).astype(np.uint8)


@cache
def _shares() -> Array:
    """Variance of an interpolated channel for each unit of variance of the photosites of another.

    [2, 4, 3, 3]: along rows and columns; site as `_kinds` has it; channel made; channel of the photosites.
    Sums of squared impulse responses, without the limits of green.
    """
    size, table = 32, np.zeros((2, 4, 3, 3))
    sites = Cfa.RGGB.channels(size, size)
    kinds = _kinds(sites)
    for row, column in ((16, 16), (16, 17), (17, 16), (17, 17)):
        impulse = np.zeros((size, size), np.float32)
        impulse[row, column] = 1
        for way in (0, 1):
            made = np.where(sites == 1, impulse, sum(_along(impulse, k)[way] for k in (_HALF, _CURVE)))
            planes = colours(impulse, sites, np.full(sites.shape, way == 0), made.astype(np.float32))
            for site in range(4):
                for channel in range(3):
                    square = np.square(planes[kinds == site, channel], dtype=np.float64).sum()
                    table[way, site, channel, sites[row, column]] += square
    return table


def _toe(light: Array32, sigma: Floats | None, cfa: Cfa) -> float:
    """Return where the code turns from linear to logarithmic, which it must not within the noise.

    The least change between photosites of a colour stands in for noise that is not known; only of Bayer is
    that every other one.
    """
    if sigma is None and not cfa.bayer:
        least = 0.0
    elif sigma is None:
        change = np.abs(_filtered(light, _CURVE)) / np.float32(np.sqrt(np.square(_CURVE).sum()))
        least = float(np.percentile(change, 25)) / QUARTER
    else:
        finite = sigma[np.isfinite(sigma)]
        least = float(np.percentile(finite, 1)) if finite.size else 0.0
    toe = max(TOE_OF_LIGHT * float(np.median(np.abs(light))), TOE_OF_NOISE * least)
    return toe if toe > 0 else float(np.abs(light).max()) or 1.0


def _stand_in(image: Floats, trusted: Mask) -> Array32:
    """Mean of the nearest photosites of the same colour, 0 without any."""
    kernel = np.zeros((5, 5), np.float32)
    kernel[::2, ::2] = 1
    weight = _filtered(trusted.astype(np.float32), kernel)
    total = _filtered(np.where(trusted, image, 0).astype(np.float32), kernel)
    return np.asarray(total / np.maximum(weight, 1), np.float32)


def _along(values: Array32, kernel: Array32) -> tuple[Array32, Array32]:
    """Filtered along rows, and along columns."""
    return _filtered(values, kernel), _filtered(values, kernel.T)


def _filtered(values: Array32, kernel: Array32) -> Array32:
    """Mirrored at the edges, which leaves every photosite its colour."""
    result = cv2.filter2D(
        np.ascontiguousarray(values, np.float32), -1, np.ascontiguousarray(kernel),
        borderType=cv2.BORDER_REFLECT_101,
    )  # fmt: skip
    return np.asarray(result)

# mypy: allow-untyped-defs, allow-untyped-calls
"""Photographs beside an image of display values, and the gradient, in one pass over memory each, for the CPU.

Plain operations make gains, planes and bounds of every sample anew in some twenty passes, forward and back.
"""

from typing import Any

import numpy as np
import torch
from torch import Tensor

from imaging.arrays import Array32
from imaging.compute.jit import inlined, kernel
from imaging.compute.threads import share, take_number

ROWS = 16
"""Rows that a thread takes at a time."""
_STEP = 1 / 255
"""A whole number of 8 bits times it in float64, rounded to float32, is the number over 255 in float32."""


def photographed(
    image: Tensor,
    shade: Array32,
    gains: Array32,
    stored: Tensor,
    below: Tensor | None,
    above: Tensor | None,
) -> tuple[Tensor, Tensor]:
    """Prediction and codes of photographs, float32 [shots * 3, H, W], of an image on the CPU.

    The prediction of a shot is the image times the shade times its gains. Differentiable in the image.

    Args:
        image: Display values, float32 [H, W, 3].
        shade: Factors on each pixel, the same for all shots, [H, W]; of size 0: 1 everywhere.
        gains: Factors on the channels of each shot, [shots, 3].
        stored: Codes of the photographs, [shots * 3, H, W]: float32 in 0..1, or uint8, which are divided by
            255.
        below: Mask [shots * 3, H, W] of where predictions below the code count as it, without gradient; None:
            nowhere.
        above: The same for predictions above the code.

    Returns:
        The prediction, and the codes in 0..1.
    """
    result: tuple[Tensor, Tensor]
    result = _Photographed.apply(image, (shade, gains, stored, below, above))
    return result


class _Photographed(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, image: Tensor, constants: tuple[Any, ...]) -> tuple[Tensor, Tensor]:
        shade, gains, stored, below, above = constants
        image = image.detach().contiguous()
        sides = tuple(np.empty(0, bool) if side is None else side.numpy().ravel() for side in (below, above))
        step = _STEP if stored.dtype == torch.uint8 else 1.0
        ctx.given = image, shade.ravel(), gains, stored.numpy().ravel(), step, *sides
        prediction, target = torch.empty(stored.shape), torch.empty(stored.shape)
        height, width, _ = image.shape
        share(
            _forward, 5e-4 * stored.numel(), height, width, image.numpy().ravel(), *ctx.given[1:],
            prediction.numpy().ravel(), target.numpy().ravel(),
        )  # fmt: skip
        ctx.mark_non_differentiable(target)
        return prediction, target

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        image, *given = ctx.given
        outer = gradients[0].detach().contiguous()
        height, width, _ = image.shape
        gradient = torch.empty(image.shape)
        share(
            _backward, 5e-4 * outer.numel(), height, width, image.numpy().ravel(), *given,
            outer.numpy().ravel(), gradient.numpy().ravel(),
        )  # fmt: skip
        return gradient, None


@inlined
def _shown(light, shade, gain, values):
    """Display values of a plane's row, [W], behind its gain."""
    if len(shade):
        for x in range(len(values)):
            values[x] = light[x] * (shade[x] * gain)
    else:
        for x in range(len(values)):
            values[x] = light[x] * gain


@inlined
def _apart(image, channels):
    """Split a row of an image, [3 W], into its channels, float32 [3, W]."""
    red, green, blue = channels[0], channels[1], channels[2]
    for x in range(len(red)):
        red[x] = image[3 * x]
        green[x] = image[3 * x + 1]
        blue[x] = image[3 * x + 2]


@kernel
def _forward(counter, height, width, image, shade, gains, stored, step, below, above, prediction, target):
    """Fill prediction and target; each step is a loop over a row, which the compiler makes vectors of."""
    task, channels = take_number(counter), np.empty((3, width), np.float32)
    while task * ROWS < height:
        for row in range(task * ROWS, min((task + 1) * ROWS, height)):
            pixel = row * width
            _apart(image[3 * pixel : 3 * (pixel + width)], channels)
            for plane in range(3 * len(gains)):
                at = (plane * height + row) * width
                values, codes, whole = (
                    prediction[at : at + width],
                    target[at : at + width],
                    stored[at : at + width],
                )
                _shown(
                    channels[plane % 3], shade[pixel : pixel + width], gains[plane // 3, plane % 3], values
                )
                for x in range(width):
                    codes[x] = np.float32(whole[x] * step)
                if len(below):
                    bounds = below[at : at + width]
                    for x in range(width):
                        v, code = values[x], codes[x]
                        values[x] = code if bounds[x] & (v < code) else v
                if len(above):
                    bounds = above[at : at + width]
                    for x in range(width):
                        v, code = values[x], codes[x]
                        values[x] = code if bounds[x] & (v > code) else v
        task = take_number(counter)


@kernel
def _backward(counter, height, width, image, shade, gains, stored, step, below, above, outer, gradient):
    """Add up d loss / d image over the shots; what is beyond a code that bounds the light adds nothing."""
    task, zero = take_number(counter), np.float32(0.0)
    channels, sums = np.empty((3, width), np.float32), np.empty((3, width), np.float32)
    values, codes, pull = (
        np.empty(width, np.float32),
        np.empty(width, np.float32),
        np.empty(width, np.float32),
    )
    while task * ROWS < height:
        for row in range(task * ROWS, min((task + 1) * ROWS, height)):
            pixel = row * width
            _apart(image[3 * pixel : 3 * (pixel + width)], channels)
            sums[:] = zero
            for plane in range(3 * len(gains)):
                at, shades, gain = (
                    (plane * height + row) * width,
                    shade[pixel : pixel + width],
                    gains[plane // 3, plane % 3],
                )
                whole, total = stored[at : at + width], sums[plane % 3]
                _shown(outer[at : at + width], shades, gain, pull)
                if len(below) or len(above):
                    _shown(channels[plane % 3], shades, gain, values)
                    for x in range(width):
                        codes[x] = np.float32(whole[x] * step)
                if len(below):
                    bounds = below[at : at + width]
                    for x in range(width):
                        g = pull[x]
                        pull[x] = zero if bounds[x] & (values[x] < codes[x]) else g
                if len(above):
                    bounds = above[at : at + width]
                    for x in range(width):
                        g = pull[x]
                        pull[x] = zero if bounds[x] & (values[x] > codes[x]) else g
                for x in range(width):
                    total[x] += pull[x]
            red, green, blue, out = sums[0], sums[1], sums[2], gradient[3 * pixel : 3 * (pixel + width)]
            for x in range(width):
                out[3 * x] = red[x]
                out[3 * x + 1] = green[x]
                out[3 * x + 2] = blue[x]
        task = take_number(counter)

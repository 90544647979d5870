# mypy: allow-untyped-defs, allow-untyped-calls
"""L1 and SSIM of planes with their gradient, in one pass over memory.

SSIM: Wang et al. 2004, Gaussian window of 11 taps, sigma 1.5, K1 = 0.01, K2 = 0.03, for values on 0..1.
The mean is over all pixels; windows at the border see zeros outside, in both images, as in 3DGS.
(`imaging.metrics.ssim`, which is for reporting, takes only windows that lie wholly inside; away from
the border the two agree.) Variances that rounding made negative count as 0.
"""

from typing import Any

import numpy as np
import torch

from imaging.compute.jit import inlined, kernel
from imaging.compute.threads import share, take_number
from imaging.metrics import SSIM_C1, SSIM_C2, SSIM_RADIUS, ssim_taps
from recon.observe.losses.dense_ssim import dense_photometric_loss
from recon.splat.cpu.lanes import (
    WIDTH,
    above,
    choose,
    fma,
    keep_first,
    load,
    load_first,
    maximum,
    splat,
    store,
    store_first,
    total,
)

STRIP = 64
"""Rows that a thread takes at a time; 2 SSIM_RADIUS more are needed on either side."""
GROUP = 4
"""Rows that are filtered down the columns together, so that a row that is read serves four."""
_C1, _C2 = np.float32(SSIM_C1), np.float32(SSIM_C2)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_ZERO = np.float32(0.0)


_TAPS = np.concatenate([np.zeros(GROUP - 1), ssim_taps(), np.zeros(GROUP - 1)]).astype(np.float32)
"""Band matrix of the taps, with zeros around: tap of source row i for row j of a group is _TAPS[GROUP - 1 + i
- j].
"""


@inlined
def _zeros():
    return splat(_ZERO)


@inlined
def _row(array, at, count):
    """Sixteen values, or the `count` that are left of a row and zeros."""
    if count >= WIDTH:
        return load(array, at)
    return load_first(array, at, count)


@inlined
def _add_pair(sums, tap, x, y, squares, product):
    a, b, c, d = sums
    return fma(x, tap, a), fma(y, tap, b), fma(squares, tap, c), fma(product, tap, d)


@inlined
def _down_images(x, y, plane, first, height, width, taps, stride, out):
    """Filter x, y, x^2 + y^2 and x y down the columns at rows first .. first + 3.

    out float32 [4 rows, 4 maps, stride]: columns from WIDTH on, zeros around.
    """
    for c in range(0, width, WIDTH):
        n = width - c
        z = _zeros()
        s0 = s1 = s2 = s3 = (z, z, z, z)
        for i in range(GROUP + 2 * SSIM_RADIUS):
            row = first - SSIM_RADIUS + i
            if 0 <= row < height:
                at = plane + row * width + c
                a, b = _row(x, at, n), _row(y, at, n)
                squares, product = fma(a, a, b * b), a * b
                s0 = _add_pair(s0, taps[i + 3], a, b, squares, product)
                s1 = _add_pair(s1, taps[i + 2], a, b, squares, product)
                s2 = _add_pair(s2, taps[i + 1], a, b, squares, product)
                s3 = _add_pair(s3, taps[i], a, b, squares, product)
        _store_maps(out, WIDTH + c, stride, s0)
        _store_maps(out, WIDTH + c + 4 * stride, stride, s1)
        _store_maps(out, WIDTH + c + 8 * stride, stride, s2)
        _store_maps(out, WIDTH + c + 12 * stride, stride, s3)


@inlined
def _store_maps(out, at, stride, maps):
    a, b, c, d = maps
    store(out, at, a)
    store(out, at + stride, b)
    store(out, at + 2 * stride, c)
    store(out, at + 3 * stride, d)


@inlined
def _across(rows, at, taps):
    """Filter along a row, at sixteen columns."""
    result = load(rows, at) * taps[8]
    for k in range(1, SSIM_RADIUS + 1):
        result = fma(load(rows, at - k) + load(rows, at + k), taps[8 + k], result)
    return result


@inlined
def _structure(rows, at, stride, taps):
    """SSIM at sixteen pixels and its derivatives by mean x, mean of squares, mean of products."""
    mx, my = _across(rows, at, taps), _across(rows, at + stride, taps)
    squares, product = _across(rows, at + 2 * stride, taps), _across(rows, at + 3 * stride, taps)
    means, both = mx * my, fma(mx, mx, my * my)
    a = fma(means, _TWO, _C1)
    b = fma(product - means, _TWO, _C2)
    c = both + _C1
    d = maximum(squares - both, _ZERO) + _C2
    inverse = _ONE / (c * d)
    f = a * b * inverse
    by_squares = _ZERO - f / d
    by_mean = _TWO * (my * (b - a) * inverse - mx * (f / c + by_squares))
    return f, by_mean, by_squares, _TWO * a * inverse


@inlined
def _strip_values(x, y, plane, start, stop, height, width, taps, stride, rows, parts, alike, apart, base):
    """Derivatives of SSIM at rows start - 5 .. stop + 4 into parts [rows, 3, stride], and the sums of rows.

    alike, apart float64 [planes * height]: sums of SSIM and of |x - y|.
    """
    for first in range(start - SSIM_RADIUS, stop + SSIM_RADIUS, GROUP):
        if first + GROUP <= 0 or first >= height:
            continue
        _down_images(x, y, plane, first, height, width, taps, stride, rows)
        for j in range(GROUP):
            row = first + j
            if row < 0 or row >= height or row >= stop + SSIM_RADIUS:
                continue
            local = (row - start + SSIM_RADIUS) * 3 * stride + WIDTH
            values, distance = _zeros(), _zeros()
            for c in range(0, width, WIDTH):
                n = width - c
                f, by_mean, by_squares, by_product = _structure(
                    rows, 4 * j * stride + WIDTH + c, stride, taps
                )
                store(parts, local + c, keep_first(n, by_mean))
                store(parts, local + stride + c, keep_first(n, by_squares))
                store(parts, local + 2 * stride + c, keep_first(n, by_product))
                if start <= row < stop:
                    at = plane + row * width + c
                    d = _row(x, at, n) - _row(y, at, n)
                    values = values + keep_first(n, f)
                    distance = distance + maximum(d, _ZERO - d)
            if start <= row < stop:
                alike[base + row] = total(values)
                apart[base + row] = total(distance)


@inlined
def _add_three(sums, tap, x, y, z):
    a, b, c = sums
    return fma(x, tap, a), fma(y, tap, b), fma(z, tap, c)


@inlined
def _store_three(out, at, stride, maps):
    a, b, c = maps
    store(out, at, a)
    store(out, at + stride, b)
    store(out, at + 2 * stride, c)


@inlined
def _down_parts(parts, local, first, height, width, taps, stride, out):
    """Filter the three derivatives down the columns at rows first .. first + 3 (local: index of `first`)."""
    for c in range(0, width, WIDTH):
        z = _zeros()
        s0 = s1 = s2 = s3 = (z, z, z)
        for i in range(GROUP + 2 * SSIM_RADIUS):
            row = first - SSIM_RADIUS + i
            # The last group of a strip may reach beyond it, for rows that are not read.
            if 0 <= row < height and (local + i) * 3 * stride < len(parts):
                at = (local + i) * 3 * stride + WIDTH + c
                a, b, d = load(parts, at), load(parts, at + stride), load(parts, at + 2 * stride)
                s0 = _add_three(s0, taps[i + 3], a, b, d)
                s1 = _add_three(s1, taps[i + 2], a, b, d)
                s2 = _add_three(s2, taps[i + 1], a, b, d)
                s3 = _add_three(s3, taps[i], a, b, d)
        _store_three(out, WIDTH + c, stride, s0)
        _store_three(out, WIDTH + c + 4 * stride, stride, s1)
        _store_three(out, WIDTH + c + 8 * stride, stride, s2)
        _store_three(out, WIDTH + c + 12 * stride, stride, s3)


@inlined
def _strip_gradient(x, y, plane, start, stop, height, width, taps, stride, rows, parts, like, near, gradient):
    """d loss / d x at rows start .. stop - 1; like, near: weights of SSIM and L1, per pixel."""
    for first in range(start, stop, GROUP):
        _down_parts(parts, first - start, first, height, width, taps, stride, rows)
        for row in range(first, min(first + GROUP, stop)):
            base = 4 * (row - first) * stride + WIDTH
            for c in range(0, width, WIDTH):
                n = width - c
                at = plane + row * width + c
                a, b = _row(x, at, n), _row(y, at, n)
                by_mean = _across(rows, base + c, taps)
                by_squares = _across(rows, base + stride + c, taps)
                by_product = _across(rows, base + 2 * stride + c, taps)
                g = fma(_TWO * a, by_squares, fma(b, by_product, by_mean)) * (_ZERO - like)
                d = a - b
                up = choose(above(d, _ZERO), splat(near), _ZERO)
                g = g + choose(above(_ZERO, d), splat(_ZERO - near), up)
                if n >= WIDTH:
                    store(gradient, at, g)
                else:
                    store_first(gradient, at, n, g)


@kernel
def compare(counter, x, y, planes, height, width, taps, like, near, alike, apart, gradient):
    """L1 and SSIM of float32 [planes * height * width]; gradient likewise, or empty if it is not wanted."""
    stride = -(-width // WIDTH) * WIDTH + 2 * WIDTH
    rows = np.zeros(4 * GROUP * stride, np.float32)
    parts = np.zeros((STRIP + 2 * SSIM_RADIUS) * 3 * stride, np.float32)
    strips = -(-height // STRIP)
    task = take_number(counter)
    while task < planes * strips:
        number, strip = task // strips, task % strips
        start, stop = strip * STRIP, min((strip + 1) * STRIP, height)
        plane = number * height * width
        _strip_values(
            x, y, plane, start, stop, height, width, taps, stride, rows, parts, alike, apart,
            number * height,
        )  # fmt: skip
        if len(gradient):
            _strip_gradient(
                x, y, plane, start, stop, height, width, taps, stride, rows, parts, like, near, gradient
            )
        task = take_number(counter)


class _Photometric(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, prediction: torch.Tensor, target: torch.Tensor, weight: float, keep: bool) -> Any:
        x, y = (tensor.detach().contiguous() for tensor in (prediction, target))
        planes, height, width = x.shape
        gradient = torch.empty(x.shape if keep else 0)
        alike, apart = np.empty(planes * height), np.empty(planes * height)
        share(
            compare, 0.005 * x.numel(), x.numpy().ravel(), y.numpy().ravel(), planes, height, width, _TAPS,
            np.float32(weight / x.numel()), np.float32((1 - weight) / x.numel()), alike, apart,
            gradient.numpy().ravel(),
        )  # fmt: skip
        ctx.save_for_backward(gradient)
        near, like = apart.sum() / x.numel(), alike.sum() / x.numel()
        return prediction.new_tensor((1 - weight) * near + weight * (1 - like))

    @staticmethod
    def backward(ctx: Any, *gradients: torch.Tensor) -> tuple[torch.Tensor | None, ...]:
        (gradient,) = ctx.saved_tensors
        # Of a loss that is not weighed further, that spares a pass over memory.
        return gradient if gradients[0] == 1 else gradient * gradients[0], None, None, None


def photometric_loss(prediction: torch.Tensor, target: torch.Tensor, ssim_weight: float) -> torch.Tensor:
    """`(1 - w) mean |x - y| + w (1 - SSIM)`, a scalar, of float32 planes [P, H, W].

    Differentiable in the prediction only. SSIM is on values of about 0..1, each plane apart, then
    averaged over all pixels. Pixels to be left out: give them the target's value in the prediction.
    ValueError for other shapes or dtypes, and for empty planes. On the CPU value and gradient come from
    one pass over memory.
    """
    for name, tensor in (("prediction", prediction), ("target", target)):
        if tensor.ndim != 3 or tensor.numel() == 0 or tensor.shape != prediction.shape:
            raise ValueError(f"{name} has shape {tuple(tensor.shape)}: planes [P, H, W] of one shape needed")
        if tensor.dtype != torch.float32 or tensor.device != prediction.device:
            raise ValueError(f"{name} is {tensor.dtype} on {tensor.device}: float32 on one device needed")
    if prediction.device.type != "cpu":
        return dense_photometric_loss(prediction, target, ssim_weight)
    keep = torch.is_grad_enabled() and prediction.requires_grad
    loss: torch.Tensor = _Photometric.apply(prediction, target, ssim_weight, keep)
    return loss

"""A learned tone curve between radiance and code values: monotone by construction, leaky at its ends.

HDRGS (Wu et al., arXiv 2408.06543): `C = g(x)`, `x = r (ln E + ln k - m)`, one curve for each colour
channel, sampled on a grid that is finer in the middle.
"""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor
from torch.nn.functional import softplus

from imaging.arrays import Array
from imaging.merge.linear_frame import decode
from imaging.session.calibration import Response
from recon.data.tone import encode
from recon.observe.kernels.tone_curve_kernel import look_up

LEAK = 0.01
LOW, CORE_LOW, CORE_HIGH, HIGH = -10.0, -5.0, 2.5, 5.0
"""Ends of the grid on the x axis, and between them those of its middle, the core."""
CORE_DENSITY, TAIL_DENSITY = 128, 64
"""Nodes per unit of x."""
EXACT = 0.1 / 255
"""Codes, of 1, within which a curve that is known has to be held: a third of what rounding to 8 bits does."""


def remap_rate(scales: Sequence[float]) -> float:
    """r: how much one natural logarithm of exposure moves x; from the distinct exposure scales.

    The smallest gap between neighbouring exposures becomes 2. Exposures are first clustered to 1/6
    stop, and r is kept within 0.25..2, or auto-exposure with hundreds of distinct times would blow
    it up. 1 for a single exposure.
    """
    stops = np.unique(np.round(np.log2(np.asarray(scales)) * 6) / 6)
    if len(stops) < 2:
        return 1.0
    return float(np.clip(2 / (np.diff(stops).min() * np.log(2)), 0.25, 2.0))


def grid_nodes() -> Array:
    """x of every node, rising, float64 [M]: three uniform segments, the core twice as dense."""
    parts = [
        (LOW, CORE_LOW, TAIL_DENSITY),
        (CORE_LOW, CORE_HIGH, CORE_DENSITY),
        (CORE_HIGH, HIGH, TAIL_DENSITY),
    ]
    pieces = [
        np.linspace(start, end, round((end - start) * density), endpoint=False)
        for start, end, density in parts
    ]
    return np.concatenate([*pieces, [HIGH]])


def needed(nodes: Array, curves: Array) -> npt.NDArray[np.intp]:
    """Mask of the nodes [M] that curves [..., M] need: straight lines between them are within `EXACT` of all
    others.

    From the left, each line as long as it may be. The first node and the last are always among them.
    """
    rows, chosen = curves.reshape(-1, len(nodes)), [0]
    while chosen[-1] < len(nodes) - 1:
        start, reach = chosen[-1], 1
        while start + reach < len(nodes) - 1 and _straight(nodes, rows, start, start + reach + 1):
            reach += 1
        chosen.append(start + reach)
    return np.array(chosen)


def _straight(nodes: Array, rows: Array, start: int, end: int) -> bool:
    """Return whether one line does from one node to another."""
    share = (nodes[start : end + 1] - nodes[start]) / (nodes[end] - nodes[start])
    line = rows[:, [start]] + share * (rows[:, [end]] - rows[:, [start]])
    return bool((np.abs(line - rows[:, start : end + 1]) <= EXACT).all())


def curve_values(theta: Tensor) -> Tensor:
    """Free parameters [..., M - 1] -> values at the nodes [..., M], rising strictly from 0 to 1."""
    total = softplus(theta).cumsum(-1)
    values = total / total[..., -1:]
    return torch.cat([torch.zeros_like(values[..., :1]), values], -1)


def curve_parameters(values: Array) -> Tensor:
    """Parameters whose curve has these values [..., M] at the nodes; flat places get a tiny slope."""
    steps = np.maximum(np.diff(values, axis=-1), 1e-7)
    steps = steps / steps.mean(-1, keepdims=True) * np.log(2)
    return torch.from_numpy(
        np.where(steps > 20, steps, np.log(np.expm1(np.minimum(steps, 20)))).astype(np.float32)
    )


def apply_curve(x: Tensor, values: Tensor, nodes: Tensor, *, leaky: bool) -> Tensor:
    """g(x) [...] for one channel's curve; differentiable in x and in the values.

    Args:
        x: Samples of any shape.
        values: Values of the curve at the nodes, [M], from 0 to 1.
        nodes: Rising places of the nodes on the x axis, [M], from a to b.
        leaky: True for training: `LEAK (x - a)` below the grid, `1 + LEAK - LEAK / sqrt(x - b + 1)` above,
            both continuous, so that no sample is without gradient. False: clamped to 0..1.

    Returns:
        Code values, of the shape of x.
    """
    if leaky and x.device.type == "cpu" and x.dtype == values.dtype == nodes.dtype == torch.float32:
        return look_up(x, values, nodes, LEAK)
    low, high = nodes[0], nodes[-1]
    inside = x.clamp(low, high)
    index = (torch.searchsorted(nodes, inside.detach().contiguous()) - 1).clamp(0, len(nodes) - 2)
    share = (inside - nodes[index]) / (nodes[index + 1] - nodes[index])
    curve = values[index] + share * (values[index + 1] - values[index])
    if not leaky:
        return curve
    below = LEAK * (x - low)
    # The argument is clamped before the branch is chosen: the other branch would give NaN gradients.
    above = 1 + LEAK - LEAK / (x - high + 1).clamp_min(1.0).sqrt()
    return torch.where(x < low, below, torch.where(x > high, above, curve))


def roughness(values: Tensor, nodes: Tensor) -> Tensor:
    """Mean squared second derivative of curves [..., M] at the inner nodes: a scalar.

    Divided differences on the uneven grid; an undivided sum would be about 1e-7 and do nothing.
    """
    steps = nodes[1:] - nodes[:-1]
    slopes = (values[..., 1:] - values[..., :-1]) / steps
    second = (slopes[..., 1:] - slopes[..., :-1]) / (0.5 * (steps[1:] + steps[:-1]))
    return second.square().mean()


def middle_of(response: Response) -> float:
    """ln (E k) at code 0.5, averaged over the channels: where x = 0 lies."""
    return float(np.log(np.maximum(decode(np.full((1, 3), 0.5), response), 1e-12)).mean())


def sampled(response: Response, nodes: Array, rate: float, middle: float) -> Tensor:
    """The curve of a calibrated or assumed response at the nodes, as parameters [3, M - 1].

    Args:
        response: Response of a camera.
        nodes: Places of the nodes on the x axis, [M].
        rate: Factor r of `x = r (ln E + ln k - m)` (`remap_rate`).
        middle: Constant m of it, ln (E k) where x is 0 (`middle_of`).

    Returns:
        Parameters, float32, of which `curve_values` makes the curve.
    """
    light = np.exp(nodes / rate + middle)
    codes = encode(np.repeat(light[:, None], 3, axis=1), response).astype(np.float64)
    # The response is flat where it clips; a little of a sigmoid there keeps the curve rising.
    rising = 1 / (1 + np.exp(-nodes))
    values = 0.98 * codes.T + 0.02 * rising[None]
    values = (values - values[:, :1]) / (values[:, -1:] - values[:, :1])
    return curve_parameters(values)

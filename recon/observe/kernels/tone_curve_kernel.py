"""A leaky tone curve and its gradient in one pass over memory each, for the CPU.

Plain operations look every sample up and choose among three branches in some twenty passes, forward and
back: on photographs that took longer than everything else in a training step together.
"""

from typing import Any

import numpy as np
import torch
from torch import Tensor

from imaging.arrays import AnyArray
from imaging.compute.jit import kernel
from imaging.compute.threads import share, take_number

TASK = 1 << 15
"""Samples that a thread takes at a time; sums are per task, so that no thread count changes a bit."""

CELLS = 1 << 12
"""Equal parts of the grid, each of which knows its node: nodes lie anywhere, and halving again and again to
find the one below a sample costs a misjudged branch each time, four times all the rest."""


def look_up(x: Tensor, values: Tensor, nodes: Tensor, leak: float) -> Tensor:
    """Look up as `recon.observe.tone_grid.apply_curve`, leaky, for float32 tensors on the CPU.

    Args:
        x: Samples of any shape.
        values: Values of the curve at the nodes, [M], from 0 to 1.
        nodes: Rising places of the nodes on the x axis, [M]; constants without gradient.
        leak: Slope below the grid; just above the grid the slope begins at half of it.

    Returns:
        g(x), of the shape of x, differentiable in x and in the values.
    """
    result: Tensor = _LookUp.apply(x, values, nodes, leak)  # type: ignore[no-untyped-call]
    return result


class _LookUp(torch.autograd.Function):
    """x of any shape, values [M] -> g(x); the nodes [M] are constants."""

    @staticmethod
    def forward(ctx: Any, x: Tensor, values: Tensor, nodes: Tensor, leak: float) -> Tensor:
        flat, curve, at = (tensor.detach().contiguous().numpy().ravel() for tensor in (x, values, nodes))
        out, slope, part = (np.empty(len(flat), np.float32) for _ in range(3))
        index = np.empty(len(flat), np.int32)
        edges = np.linspace(at[0], at[-1], CELLS, endpoint=False)
        first = (np.searchsorted(at, edges) - 1).clip(0, len(at) - 2).astype(np.int32)
        share(_forward, 0.01 * len(flat), flat, curve, at, first, np.float32(leak), out, slope, index, part)
        ctx.slopes, ctx.shape, ctx.nodes = (slope, index, part), x.shape, len(at)
        return torch.from_numpy(out.reshape(x.shape))

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        slope, index, part = ctx.slopes
        outer = gradients[0].detach().contiguous().numpy().ravel()
        grad_x = torch.from_numpy((outer * slope).reshape(ctx.shape)) if ctx.needs_input_grad[0] else None
        grad_values = None
        if ctx.needs_input_grad[1]:
            sums = np.zeros((-(-len(outer) // TASK), ctx.nodes))
            share(_backward, 0.005 * len(outer), outer, index, part, sums)
            grad_values = torch.from_numpy(sums.sum(0).astype(np.float32))
        return grad_x, grad_values, None, None


@kernel
def _forward(
    counter: AnyArray, x: AnyArray, values: AnyArray, nodes: AnyArray, first: AnyArray, leak: float,
    out: AnyArray, slope: AnyArray, index: AnyArray, part: AnyArray,
) -> None:  # fmt: skip
    """out = g(x), slope = dg/dx; index of the node below (-1 outside the grid) and the part of the way on.

    first [CELLS]: the node below the lower end of each cell, from where the search begins.
    """
    count, last = len(x), len(nodes) - 1
    low, high, one = nodes[0], nodes[last], np.float32(1.0)
    fine = np.float32(CELLS) / (high - low)
    task = take_number(counter)
    while task * TASK < count:
        for i in range(task * TASK, min((task + 1) * TASK, count)):
            v = x[i]
            if v < low:
                out[i], slope[i], index[i], part[i] = leak * (v - low), leak, -1, 0.0
            elif v > high:
                root = np.sqrt(v - high + one)
                out[i], slope[i] = one + leak - leak / root, np.float32(0.5) * leak / (root * root * root)
                index[i], part[i] = -1, 0.0
            else:
                below = first[min(max(int((v - low) * fine), 0), CELLS - 1)]
                while below > 0 and nodes[below] >= v:
                    below -= 1
                while below < last - 1 and nodes[below + 1] < v:
                    below += 1
                step, rise = nodes[below + 1] - nodes[below], values[below + 1] - values[below]
                way = (v - nodes[below]) / step
                out[i], slope[i] = values[below] + way * rise, rise / step
                index[i], part[i] = below, way
        task = take_number(counter)


@kernel
def _backward(counter: AnyArray, outer: AnyArray, index: AnyArray, part: AnyArray, sums: AnyArray) -> None:
    """d loss / d values, of each task's samples: sums float64 [tasks, M]."""
    count = len(outer)
    task = take_number(counter)
    while task * TASK < count:
        for i in range(task * TASK, min((task + 1) * TASK, count)):
            k = index[i]
            if k >= 0:
                g, way = np.float64(outer[i]), np.float64(part[i])
                sums[task, k] += g * (1.0 - way)
                sums[task, k + 1] += g * way
        task = take_number(counter)

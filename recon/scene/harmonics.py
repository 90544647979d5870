"""Real spherical harmonics up to degree 2, in the order and with the signs of 3DGS."""

from typing import Any

import numpy as np
import torch
from torch import Tensor

from imaging.arrays import Array, Floats
from imaging.compute.jit import kernel

C0 = 0.28209479177387814
C1 = 0.4886025119029199
C2 = (1.0925484305920792, -1.0925484305920792, 0.31539156525252005, -1.0925484305920792, 0.5462742152960396)

DEGREE = 2
COEFFICIENTS = (DEGREE + 1) ** 2


def basis(directions: Tensor, degree: int) -> Tensor:
    """Values of the harmonics at unit directions [N, 3], world axes: [N, (degree + 1)^2].

    Directions point from the camera to the Gaussian, as in 3DGS.
    """
    x, y, z = directions.unbind(-1)
    values = [torch.full_like(x, C0)]
    if degree > 0:
        values += [-C1 * y, C1 * z, -C1 * x]
    if degree > 1:
        values += [
            C2[0] * x * y,
            C2[1] * y * z,
            C2[2] * (2 * z * z - x * x - y * y),
            C2[3] * x * z,
            C2[4] * (x * x - y * y),
        ]
    return torch.stack(values, -1)


def series(constant: Tensor, rest: Tensor, directions: Tensor, degree: int) -> Tensor:
    """Sum of a series at one direction each, using degrees up to `degree`: [N, C].

    Args:
        constant: Coefficients of degree 0, [N, 1, C]; differentiable.
        rest: Coefficients of degrees 1 and 2, [N, 8, C]; differentiable.
        directions: Unit vectors [N, 3] from the camera to the Gaussians, world axes; taken as constants, as
            in 3DGS.
        degree: Highest degree in use, 0 to 2.

    Returns:
        The sums.
    """
    if degree == 0:
        return C0 * constant[:, 0]
    if constant.device.type != "cpu":
        return series_by_torch(constant, rest, directions, degree)
    result: Tensor = _Series.apply(constant, rest, directions, degree)  # type: ignore[no-untyped-call]
    return result


def series_by_torch(constant: Tensor, rest: Tensor, directions: Tensor, degree: int) -> Tensor:
    """Evaluate as `series`, in plain torch operations, for devices that Numba does not support."""
    values = basis(directions.detach().to(rest.dtype), degree)
    coefficients = torch.cat([constant, rest[:, : values.shape[1] - 1]], 1)
    return torch.einsum("nk,nkc->nc", values, coefficients)


class _Series(torch.autograd.Function):
    """The sum and its gradient in one pass each; torch would take a dozen over the coefficients."""

    @staticmethod
    def forward(ctx: Any, constant: Tensor, rest: Tensor, directions: Tensor, degree: int) -> Tensor:
        towards = directions.detach().to(rest.dtype).contiguous().numpy()
        first, others = constant.detach().contiguous().numpy(), rest.detach().contiguous().numpy()
        total = np.empty((len(first), first.shape[2]), first.dtype)
        _sum(first, others, towards, degree, total)
        ctx.towards, ctx.degree = towards, degree
        return torch.from_numpy(total)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        outer = gradients[0].contiguous().numpy()
        count, channels = outer.shape
        first = np.empty((count, 1, channels), outer.dtype)
        others = np.empty((count, COEFFICIENTS - 1, channels), outer.dtype)
        _spread(outer, ctx.towards, ctx.degree, first, others)
        return torch.from_numpy(first), torch.from_numpy(others), None, None


@kernel
def _values(x: float, y: float, z: float, degree: int) -> tuple[float, ...]:
    """The eight harmonics after the constant one; 0 above the degree."""
    one = (-C1 * y, C1 * z, -C1 * x)
    if degree < 2:
        return (*one, 0.0, 0.0, 0.0, 0.0, 0.0)
    return (
        *one,
        C2[0] * x * y,
        C2[1] * y * z,
        C2[2] * (2 * z * z - x * x - y * y),
        C2[3] * x * z,
        C2[4] * (x * x - y * y),
    )


@kernel
def _sum(first: Floats, others: Floats, towards: Floats, degree: int, total: Floats) -> None:
    for n in range(len(first)):
        values = _values(towards[n, 0], towards[n, 1], towards[n, 2], degree)
        for channel in range(total.shape[1]):
            value = C0 * first[n, 0, channel]
            for k in range(8):
                value += values[k] * others[n, k, channel]
            total[n, channel] = value


@kernel
def _spread(outer: Floats, towards: Floats, degree: int, first: Floats, others: Floats) -> None:
    for n in range(len(first)):
        values = _values(towards[n, 0], towards[n, 1], towards[n, 2], degree)
        for channel in range(outer.shape[1]):
            first[n, 0, channel] = C0 * outer[n, channel]
            for k in range(8):
                others[n, k, channel] = values[k] * outer[n, channel]


def sphere(count: int = 48) -> Array:
    """Directions spread evenly over the sphere (Fibonacci spiral), float64 [count, 3]."""
    index = np.arange(count) + 0.5
    height = 1 - 2 * index / count
    angle = np.pi * (1 + np.sqrt(5)) * index
    radius = np.sqrt(1 - height**2)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), height], -1)

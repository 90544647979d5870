"""Real spherical harmonics up to degree 2, in the order and with the signs of 3DGS."""

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

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


def series(coefficients: Tensor, directions: Tensor, degree: int) -> Tensor:
    """Sum of the series [N, K, 3] at one direction each [N, 3], using degrees up to `degree`: [N, 3].

    Differentiable in the coefficients; the directions are taken as constants, as in 3DGS.
    """
    if degree == 0:
        return C0 * coefficients[:, 0]
    used = (degree + 1) ** 2
    return (basis(directions, degree)[:, :, None] * coefficients[:, :used]).sum(1)


def sphere(count: int = 48) -> npt.NDArray[np.float64]:
    """Directions spread evenly over the sphere (Fibonacci spiral), float64 [count, 3]."""
    index = np.arange(count) + 0.5
    height = 1 - 2 * index / count
    angle = np.pi * (1 + np.sqrt(5)) * index
    radius = np.sqrt(1 - height**2)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), height], -1)

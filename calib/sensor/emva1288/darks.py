"""Black level and dark current from darks at one time or several; scatter of coarsely counted darks."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import optimize, special

from calib.sensor.stack import Stack, sites
from imaging.arrays import Array, Mask

PATTERN = 1.0
"""Prior of the fixed pattern, natural log: a quarter of the scatter, with this standard deviation."""


@dataclass(frozen=True, eq=False)
class Dark:
    """black, black_error: float64 [sites], DN of the CFA sites at no time; current: DN/s and its standard
    error, None where all darks are of one time."""

    black: Array
    black_error: Array
    current: tuple[float, float] | None


@dataclass(frozen=True, eq=False)
class Mean:
    """Mean and standard error per CFA site, float64 [sites], DN; common: the correlated part of the error."""

    value: Array
    error: Array
    common: float


def mean(stack: Stack, usable: Mask) -> Mean:
    """Mean of each CFA site; the error counts what moves a whole frame, and the fixed pattern."""
    planes = zip(sites(stack.mean, stack.tile), sites(usable, stack.tile), strict=True)
    chosen = [plane[keep].astype(np.float64) for plane, keep in planes]
    still = np.array([values.std() / np.sqrt(values.size) for values in chosen])
    # All of a frame may shift; few frames show by how much only if the sites are pooled.
    moved = stack.levels - stack.levels.mean(axis=0)
    last = max(stack.frames - 1, 1)
    error = np.hypot(still, np.sqrt((moved**2).mean() / last))
    count = len(chosen)
    common = max(float((moved.mean(axis=1) ** 2).mean()) - float((moved**2).mean()) / count, 0.0)
    common *= count / (count - 1) / last
    return Mean(np.array([values.mean() for values in chosen]), np.asarray(error), float(np.sqrt(common)))


def level(times: Sequence[float], means: Sequence[Mean]) -> Dark:
    """Black of each CFA site and what it gains in a second, the same for all, from one stack or more."""
    value, sigma = np.array([mean.value for mean in means]), np.array([mean.error for mean in means])
    if len(set(times)) < 2:
        weight = 1.0 / sigma**2
        return Dark((value * weight).sum(0) / weight.sum(0), 1.0 / np.sqrt(weight.sum(0)), None)
    count = value.shape[1]
    rows = [np.hstack([np.eye(count), np.full((count, 1), time)]) for time in times]
    design = np.concatenate([row / mean[:, None] for row, mean in zip(rows, sigma, strict=True)])
    inverse = np.linalg.inv(design.T @ design)
    solution = inverse @ (design.T @ (value / sigma).reshape(-1))
    error = np.diag(inverse).copy()
    # The sites of a frame move together, which their own errors do not say.
    pull = ((inverse @ design.T)[-1] / sigma.reshape(-1)).reshape(-1, count)
    together = (pull.sum(axis=1) ** 2 - (pull**2).sum(axis=1)) * np.array(
        [mean.common for mean in means]
    ) ** 2
    error[-1] += max(float(together.sum()), 0.0)
    error = np.sqrt(error)
    return Dark(solution[:-1], error[:-1], (float(solution[-1]), float(error[-1])))


@dataclass(frozen=True, eq=False)
class Coarse:
    """Black of one CFA site with coarse or clipped counts: black, DN, scatter in time, DN; errors of both."""

    black: float
    scatter: float
    black_error: float
    scatter_error: float


def coarse(frames: Sequence[npt.NDArray[np.integer]]) -> Coarse | None:
    """Black and scatter by maximum likelihood from darks of one CFA site, DN, flattened; they are paired up.

    A photosite has `round(black + pattern + scatter z)`, not below 0: where the scatter is under half a DN,
    means and variances of the numbers are not those of the signal. The pattern is normal over the
    photosites, its size unknown. None where all numbers are equal, which bounds the scatter only.
    """
    low = min(int(frame.min()) for frame in frames)
    size = max(int(frame.max()) for frame in frames) - low + 1
    if size < 2 or size > 64 or len(frames) < 2:
        return None
    numbers = [(frame - low).astype(np.intp) for frame in frames]
    pairs = [a * size + b for a, b in zip(numbers[::2], numbers[1::2], strict=False)]
    table = np.bincount(np.concatenate(pairs), minlength=size**2).reshape(size, size)
    nodes, weights = np.polynomial.hermite_e.hermegauss(41)
    weights = weights / weights.sum()
    edges = np.arange(size + 1) + low - 0.5
    edges[0], edges[-1] = -np.inf, np.inf

    place = np.arange(size)
    mean = low + float((table * place).sum() / table.sum())
    apart = float((table * (place[:, None] - place) ** 2).sum() / table.sum()) / 2
    spread = max(float(np.sqrt(apart)), 0.1)

    def loss(values: Array) -> float:
        black, scatter, pattern = values[0], np.exp(values[1]), np.exp(values[2])
        below = special.ndtr((edges[None] - (black + pattern * nodes)[:, None]) / scatter)
        each = np.diff(below, axis=1)
        joint = np.einsum("n,ni,nj->ij", weights, each, each)
        # Half-way between two codes, or far from both, nothing distinguishes the pattern from the scatter.
        prior = 0.5 * ((values[2] - np.log(spread / 4)) / PATTERN) ** 2
        return float(prior - (table * np.log(np.maximum(joint, 1e-300))).sum())

    best = min(
        (
            optimize.minimize(loss, [mean, np.log(spread * guess), np.log(0.05)], method="Nelder-Mead",
                              options={"xatol": 1e-5, "fatol": 1e-4, "maxiter": 800})
            for guess in (0.6, 1.0)
        ),
        key=lambda result: float(result.fun),
    )  # fmt: skip
    covariance = _inverse_hessian(loss, best.x)
    if covariance is None:
        return None
    scatter = float(np.exp(best.x[1]))
    return Coarse(
        black=float(best.x[0]),
        scatter=scatter,
        # The pairs share their photosites, and with them the pattern.
        black_error=float(np.sqrt(covariance[0, 0] * len(pairs))),
        scatter_error=scatter * float(np.sqrt(covariance[1, 1])),
    )


def _inverse_hessian(loss: Callable[[Array], float], at: Array) -> Array | None:
    """Covariance of the values; None where the loss has no minimum there."""
    step = 0.004
    units = np.eye(len(at)) * step
    corners = np.array(
        [
            [loss(at + a + b) - loss(at + a - b) - loss(at - a + b) + loss(at - a - b) for b in units]
            for a in units
        ]
    )
    hessian = corners / (4 * step**2)
    if not np.all(np.linalg.eigvalsh(hessian) > 0):
        return None
    return np.asarray(np.linalg.inv(hessian))

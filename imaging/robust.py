"""Huber's function: residuals count by their square while they are small, and by their size where not."""

import numpy as np

from imaging.arrays import Array

_TINY = 1e-12
"""Far below any limit, so that a residual of nothing has the whole weight."""


def huber_weight(residual: Array, limit: float) -> Array:
    """Weights 0..1, of the same shape, by which least squares are Huber's; limit: where a square ends."""
    return np.minimum(1.0, limit / np.maximum(np.abs(residual), _TINY))


def huber_loss(residual: Array, limit: float) -> Array:
    """Half of the square of what is below the limit; beyond it, the line that goes on from there."""
    size = np.abs(residual)
    return np.where(size < limit, 0.5 * size**2, limit * (size - 0.5 * limit))


def robust_scale(residual: Array) -> float:
    """Standard deviation about zero, from the median of sizes: exact for normal residuals."""
    return 1.4826 * float(np.median(np.abs(residual)))

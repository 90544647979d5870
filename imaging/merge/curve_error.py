"""Error that a measured response adds to the sigma of merged photographs."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from imaging.arrays import Array32
from imaging.merge.bracket import ROWS, Merged
from imaging.merge.linear_frame import LinearFrame
from imaging.session.calibration import Response

_TABLE = 4_096
"""Entries of the tables that stand in for curves, evenly spread over the square root of light."""


def with_curve_error(merged: Merged, frames: Sequence[LinearFrame], response: Response) -> Merged:
    """The same, its sigma made of the noise and of the standard error of the response.

    The error of the curve is systematic: no averaging of pixels takes it away. The errors at the codes of a
    pixel's exposures, relative, count by the weights that noise gives the exposures. They are added with
    opposite signs below and above the code where the scale of the curve is fixed, since a wrong exponent
    turns the curve about it; but their sum is never less than that of independent errors.
    Nothing changes where either is not known: a sigma of noise, or standard errors.
    """
    if merged.sigma is None or not response.sigma:
        return merged
    tables, per_root = [], np.empty(3, np.float32)
    for index, (curve, known) in enumerate(zip(response.log_exposure, response.sigma, strict=True)):
        root = np.linspace(0.0, np.exp(0.5 * curve[-1]), _TABLE)
        signed = np.where(np.arange(len(known)) < np.argmin(known), -1.0, 1.0) * known
        tables.append(np.interp(2.0 * np.log(np.maximum(root, 1e-30)), curve, signed).astype(np.float32))
        per_root[index] = (_TABLE - 1) / root[-1]
    sigma = np.empty_like(merged.sigma)
    for top in range(0, len(sigma), ROWS):
        rows = slice(top, top + ROWS)
        light = np.nan_to_num(np.maximum(merged.radiance[rows], 0.0))
        total, error, square = np.zeros((3, *light.shape), np.float32)
        for frame in frames:
            weight = _weight(frame, light, rows)
            place = np.minimum(np.sqrt(light * np.float32(frame.k)) * per_root, _TABLE - 1).astype(np.intp)
            away = weight * np.stack([table[place[..., c]] for c, table in enumerate(tables)], axis=-1)
            total += weight
            error += away
            square += away**2
        error = np.maximum(np.abs(error), np.sqrt(square))
        relative = np.divide(error, total, out=np.zeros_like(error), where=total > 0)
        sigma[rows] = np.hypot(merged.sigma[rows], relative * light)
    return replace(merged, sigma=sigma)


def _weight(frame: LinearFrame, light: Array32, rows: slice) -> Array32:
    """Weight of an exposure in the mean, up to a factor: 0 where it only bounds the light."""
    assert frame.noise is not None
    usable = frame.valid[rows] & ~frame.saturated[rows] & ~frame.dark[rows]
    variance = frame.noise.variance(light * np.float32(frame.k))
    return np.asarray(np.where(usable, frame.k**2 / variance, 0.0), np.float32)

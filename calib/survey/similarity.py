"""The similarity between two sets of points that are the same, found though some of them are not."""

from dataclasses import dataclass
from itertools import combinations
from math import comb
from typing import Any

import numpy as np
from scipy.special import ndtr, stdtrit

from imaging.arrays import Array, Integers, Mask
from imaging.files.colmap import pycolmap

FEWEST = 3
MOST_TRIPLES = 4000
TOO_FAR = 4.0
"""Standard errors by which a point may miss."""
FEW = 6
"""Fewest points whose own scatter measures their accuracy."""
UNSTATED = 0.0025
"""Assumed accuracy of few points without stated errors, as a share of their spread."""
_NORM = 1.538
"""Median length of a normal vector of three coordinates, in standard deviations of one of them."""


@dataclass(frozen=True, eq=False)
class Similarity:
    """target = scale rotation source + translation; arrays may have leading axes of several similarities."""

    scale: Any
    rotation: Array
    translation: Array

    def __call__(self, source: Array) -> Array:
        """Points [..., K, 3] of the source in the target."""
        turned = source @ np.swapaxes(self.rotation, -1, -2)
        return np.asarray(np.asarray(self.scale)[..., None, None] * turned + self.translation[..., None, :])

    def inverse(self, target: Array) -> Array:
        """Points [K, 3] of the target in the source."""
        return np.asarray((target - self.translation) @ self.rotation / self.scale)

    @property
    def sim3d(self) -> Any:
        """Conversion to pycolmap's type."""
        return pycolmap.Sim3d(float(self.scale), pycolmap.Rotation3d(self.rotation), self.translation)


def fit(source: Array, target: Array, weights: Array | None = None, *, rigid: bool = False) -> Similarity:
    """The similarity with the least weighted sum of squared misses.

    Umeyama, "Least-squares estimation of transformation parameters between two point patterns", 1991.

    Args:
        source: Points [..., K, 3].
        target: The same points where they are to come to lie [..., K, 3].
        weights: Weight of each point [K]; None: all count alike.
        rigid: True for a scale of 1.

    Returns:
        The similarity; of several sets of points it has their leading axes.
    """
    share = np.ones(source.shape[-2]) if weights is None else weights
    share = (share / share.sum())[:, None]
    middle, other = (source * share).sum(-2), (target * share).sum(-2)
    here, there = source - middle[..., None, :], target - other[..., None, :]
    u, spread, vt = np.linalg.svd(np.swapaxes(there * share, -1, -2) @ here)
    signs = np.ones(spread.shape)
    signs[..., 2] = np.sign(np.linalg.det(u @ vt))
    rotation = (u * signs[..., None, :]) @ vt
    size = (here**2 * share).sum((-2, -1))
    scale = np.ones(size.shape) if rigid else (spread * signs).sum(-1) / np.where(size > 0, size, 1.0)
    translation = other - scale[..., None] * (rotation @ middle[..., None])[..., 0]
    return Similarity(scale if scale.ndim else float(scale), rotation, translation)


def consensus(
    source: Array, target: Array, noise: Array, *, rigid: bool = False, stated: bool = False
) -> tuple[Similarity, Mask, float]:
    """The similarity that most of the points agree about.

    Triples of points are tried for the least median of squared misses (Rousseeuw, 1984); then all that fit
    are taken, by the scatter of those that do.

    Args:
        source: Points [K, 3].
        target: The same points where they are to come to lie [K, 3].
        noise: Standard error of a coordinate of each point in the target, as far as it is known [K].
        rigid: True for a scale of 1.
        stated: True if no other error than the noise is expected.

    Returns:
        The similarity; which points agree [K]; and their scatter: that of a coordinate, beside the noise.
    """
    count = len(source)
    tried = fit(*_triples(source, target), rigid=rigid)
    missed = np.linalg.norm(tried(source) - target, axis=-1)
    most = FEWEST if count <= FEWEST + 1 else max(FEWEST + 1, count // 2 + 1)
    worst = np.partition(missed, most - 1, axis=-1)[:, most - 1]
    best = int(np.argmin(worst))
    residual = missed[best]
    # What few points scatter by themselves would excuse whatever they do.
    few = 0.0 if stated else UNSTATED * float(np.linalg.norm(target - target.mean(0), axis=1).max())
    scatter, surely = few, TOO_FAR
    similarity, keep = fit(source, target, rigid=rigid), np.zeros(count, bool)
    if count >= FEW:
        scatter = worst[best] / _NORM * (1 + 5 / (count - 3))
    else:
        whole = np.linalg.norm(similarity(source) - target, axis=1)
        residual = whole if (whole <= TOO_FAR * np.hypot(noise, few)).all() else residual
    for _ in range(10):
        near = residual <= np.hypot(TOO_FAR * noise, surely * scatter)
        if (near == keep).all():
            break
        keep = near
        used = near if near.sum() >= FEWEST else residual <= np.sort(residual)[FEWEST - 1]
        similarity = fit(source[used], target[used], 1 / (noise[used] ** 2 + scatter**2 + 1e-30), rigid=rigid)
        residual = np.linalg.norm(similarity(source) - target, axis=1)
        if count >= FEW:
            free = 3 * int(used.sum()) - (6 if rigid else 7)
            beyond = float((residual[used] ** 2).sum()) / free - float((noise[used] ** 2).mean())
            scatter = float(np.sqrt(max(beyond, 0.0)))
            # A scatter of few points is itself unsure: Student's t, for which scipy.stats would take a
            # second to load.
            surely = float(-stdtrit(free, ndtr(-TOO_FAR)))
    return similarity, keep, float(scatter)


def _triples(source: Array, target: Array) -> tuple[Array, Array]:
    count = len(source)
    if comb(count, 3) <= MOST_TRIPLES:
        chosen = np.array(list(combinations(range(count), 3)))
    else:
        rng = np.random.default_rng(0)
        chosen = rng.integers(0, count, (MOST_TRIPLES, 3))
        chosen = chosen[[len(set(row)) == 3 for row in chosen.tolist()]]
    return source[chosen], target[chosen]


def is_line(points: Array, noise: float) -> bool:
    """Return whether points [K, 3] lie on a line within their errors, so that a rotation about it is open."""
    spread = np.linalg.svd(points - points.mean(0), compute_uv=False) / np.sqrt(len(points))
    return bool(spread[1] <= max(3 * noise, 1e-3 * spread[0]))


def standard_errors(
    target: Array, misses: Array, noise: Array, groups: Integers | None = None
) -> tuple[float, float, float]:
    """Standard errors of a fit: of its scale, its rotation and the place of the middle.

    Errors are what noise makes, or more where misses are more than noise explains.

    Args:
        target: Points that were fitted, in the target [K, 3].
        misses: Their misses by the fit [K, 3], in the unit of the target.
        noise: Standard error of a coordinate by which each point was weighed [K], in the same unit.
        groups: Number of the group of points that err together, of each point [K]; where there are enough
            groups, errors are by their sums (the sandwich: Liang and Zeger, 1986).

    Returns:
        Errors of the scale, relative; of the rotation about its worst axis, degrees; and of the place of the
        middle along its worst axis, in the unit of the target.
    """
    weights = 1 / noise**2
    share = weights / weights.sum()
    x, y, z = (target - share @ target).T
    zero, one = np.zeros_like(x), np.ones_like(x)
    rows = [
        [x, y, z],
        [zero, -z, y],
        [z, zero, -x],
        [-y, x, zero],
        [one, zero, zero],
        [zero, one, zero],
        [zero, zero, one],
    ]
    jacobian = np.array(rows).transpose(2, 1, 0)  # [K, 3 coordinates, 7 parameters]
    curvature = np.einsum("kij,k,kil->jl", jacobian, weights, jacobian)
    inverse = np.linalg.pinv(curvature, hermitian=True)
    free = 3 * len(target) - 7
    excess = float((weights[:, None] * misses**2).sum()) / free if free > 0 else 1.0
    covariance = inverse * max(excess, 1.0)
    if groups is not None and (many := int(groups.max()) + 1) > FEWEST:
        pulls = np.zeros((many, 7))
        np.add.at(pulls, groups, np.einsum("kij,k,ki->kj", jacobian, weights, misses))
        covariance = inverse @ (pulls.T @ pulls) @ inverse * many / (many - 1)
    turn = np.degrees(np.sqrt(np.linalg.eigvalsh(covariance[1:4, 1:4])[-1].clip(0)))
    place = np.sqrt(np.linalg.eigvalsh(covariance[4:, 4:])[-1].clip(0))
    return float(np.sqrt(covariance[0, 0].clip(0))), float(turn), float(place)

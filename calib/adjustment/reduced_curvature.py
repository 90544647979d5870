"""The curvature of the robust loss in the parameters of the cameras, points adjusted along."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse

from calib.adjustment.bundle_adjustment import LOSS, Free, is_fisheye
from calib.adjustment.jacobian import Linear
from imaging.arrays import AnyArray, Array, Integers, Mask
from imaging.optics.lens import BROWN_TERMS, FISHEYE_TERMS

BUILT = {"fx": 0.2, "k1": 0.3, "cx": 0.01, "cy": 0.01, "k2": 0.1, "p1": 1e-3, "p2": 1e-3}
"""Standard deviations of terms that the ladder did not take; focal length and middle in widths of the image.
Focal length and first radial term are bounded always: a few views on a line determine them no better.
"""
BUILT_FISHEYE = {"fx": 0.2, "k1": 0.3, "k2": 0.1, "k3": 0.05, "k4": 0.02, "cx": 0.01, "cy": 0.01}
"""Standard deviations of a fisheye's terms: they trade places with one another where no point reaches the
corners.
"""


@dataclass(frozen=True, eq=False)
class Reduced:
    """Normal equations of N observations of M points, with P parameters of cameras, under a Cauchy loss.

    curvature: [P, P], points eliminated. pull: [N], slope of the loss in units of the residual; weight: [N],
    its curvature, averaged over directions. shared: sparse [P, 3M], and inverse: sparse [3M, 3M], by which
    points follow. points: sparse [2N, 3M]. variance: of a coordinate of an observation, px^2, as far as the
    loss lets it count.
    """

    curvature: Array
    pull: Array
    weight: Array
    shared: Any
    inverse: Any
    points: Any
    variance: float


def reduced(linear: Linear, scale: float) -> Reduced:
    """Eliminate the points; scale: the typical miss, px."""
    squares = (linear.residual**2).sum(1)
    pull = 1 / (1 + squares / (LOSS * scale) ** 2)
    weight = pull**2
    count, many = len(squares), int(linear.owner.max()) + 1
    blocks = np.zeros((many, 3, 3))
    np.add.at(blocks, linear.owner, weight[:, None, None] * (linear.points.mT @ linear.points))
    inverse = _by_blocks(np.linalg.pinv(blocks, rcond=1e-9, hermitian=True))
    rows = np.repeat(np.arange(2 * count), 3)
    columns = np.repeat(3 * linear.owner, 6) + np.tile(np.arange(3), 2 * count)
    points = sparse.csr_matrix((linear.points.ravel(), (rows, columns)), shape=(2 * count, 3 * many))
    weighted = linear.cameras.multiply(np.repeat(weight, 2)[:, None]).tocsr()
    shared = (weighted.T @ points).tocsr()
    curvature = (linear.cameras.T @ weighted).toarray() - (shared @ inverse @ shared.T).toarray()
    variance = float((pull**2 * squares).mean() / (2 * weight.mean()))
    return Reduced(curvature, pull, weight, shared, inverse, points, variance)


def _by_blocks(matrices: AnyArray) -> Any:
    """[M, 3, 3] along the diagonal of a sparse matrix [3M, 3M]."""
    many = len(matrices)
    return sparse.bsr_matrix((matrices, np.arange(many), np.arange(many + 1)), shape=(3 * many, 3 * many))


def built_terms(linear: Linear, reconstruction: Any, free: Free) -> tuple[Integers, Array, Mask]:
    """Columns of the terms with priors, their standard deviations, and the columns that are held.

    Terms that the ladder did not take have priors of how lenses are built; a focal length, that of the files.
    """
    taken = {"cx", "cy"} if free.principal_point else set()
    taken |= {"RADIAL": {"k2"}, "OPENCV": {"k2", "p1", "p2"}}.get(free.model, set())
    rows: list[tuple[int, float, bool]] = []
    for number, at in linear.lenses.items():
        width = reconstruction.cameras[number].width
        fisheye = is_fisheye(reconstruction.cameras[number])
        built, terms = (BUILT_FISHEYE, FISHEYE_TERMS) if fisheye else (BUILT, BROWN_TERMS)
        for term in built.keys() - taken:
            error, held = built[term] * (width if term in ("fx", "cx", "cy") else 1.0), False
            if term == "fx" and number in free.focal:
                error, held = free.focal[number].spread, free.focal[number].held
            rows.append((at + terms.index(term), error, held))
    rows.sort()
    columns, errors, holds = zip(*rows, strict=True) if rows else ((), (), ())
    return np.array(columns, np.int64), np.array(errors, np.float64), np.array(holds, np.bool_)

"""Lenses of a drawn model: no farther off than lenses differ, and without terms that may not be there."""

from collections.abc import Collection, Sequence
from typing import Any

import numpy as np

from calib.adjustment.bundle_adjustment import lens_of
from calib.adjustment.jacobian import Linear
from imaging.arrays import Array, Integers
from imaging.session.records import Rung

SURE = 3.0
"""Standard errors of a held-out gain from which a term is there beyond doubt."""
_TERMS = {
    "lens_radial_1": ("k1",),
    "lens_principal_point": ("cx", "cy"),
    "lens_radial_2": ("k1", "k2"),
    "lens_tangential": ("k1", "k2", "p1", "p2", "fx", "fy"),
    "lens_fisheye_far": ("k3", "k4", "fx", "fy"),
}


def weak_terms(rungs: Sequence[Rung]) -> frozenset[str]:
    """Return the terms that no gain of at least SURE standard errors took, but a smaller one."""
    weak, sure = set[str](), set[str]()
    for rung in rungs:
        if rung.taken and rung.gain is not None and rung.standard_error is not None:
            evident = rung.gain >= SURE * rung.standard_error
            (sure if evident else weak).update(_TERMS.get(rung.name, ()))
    return frozenset(weak - sure)


def bounded(moves: Array, curvature: Array, columns: Integers, errors: Array) -> Array:
    """Drawn moves [DRAWS, P] in which no term of a lens spreads farther than lenses differ, errors [K].

    Points that err together, or lie far from their places, pull a camera that few of them hold farther than
    the prior of independent ones allows. The rest follows its lens, as the curvature [P, P] says.
    """
    spread = np.sqrt(np.mean(moves[:, columns] ** 2, axis=0))
    back = moves[:, columns] * (np.minimum(errors / np.maximum(spread, 1e-300), 1.0) - 1.0)
    if not back.any():
        return moves
    rest = np.setdiff1d(np.arange(len(curvature)), columns)
    nearer = moves.copy()
    nearer[:, columns] += back
    nearer[:, rest] += _followed(curvature, rest, columns, back.T).T
    return nearer


def move_without(
    linear: Linear, reconstruction: Any, curvature: Array, size: Array, terms: Collection[str]
) -> Array:
    """The move [P] to lenses without some terms, and of all the rest along with them.

    curvature: [P, P], of parameters times their size [P]; as they are, pixels beside radians are too far
    apart for it.
    """
    back = np.zeros(len(curvature))
    columns = []
    for number, at in linear.lenses.items():
        lens = lens_of(reconstruction.cameras[number])
        plain = {"cx": lens.width / 2, "cy": lens.height / 2, "fx": lens.fy, "fy": lens.fx}
        for index, (term, value) in enumerate(zip(lens.names, lens.terms, strict=True)):
            if term in terms:
                columns.append(at + index)
                share = 0.5 if term in ("fx", "fy") else 1.0  # both come to their mean
                back[at + index] = share * (plain.get(term, 0.0) - value) * size[at + index]
    if columns:
        rest = np.setdiff1d(np.arange(len(curvature)), columns)
        back[rest] = _followed(curvature, rest, np.array(columns), back[columns])
    return back / size


def _followed(curvature: Array, rest: Integers, columns: Integers, moves: Array) -> Array:
    """Moves of the rest of the parameters when these columns make theirs, [K] or [K, N]."""
    at_rest, across = curvature[np.ix_(rest, rest)], curvature[np.ix_(rest, columns)]
    return np.asarray(-np.linalg.solve(at_rest, across @ moves))

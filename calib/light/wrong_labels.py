"""Single photographs whose exposure label is wrong, while those of the other views are right."""

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from calib.light.codes import Samples
from imaging.arrays import Array
from imaging.merge.linear_frame import decode
from imaging.merge.ratios import LABEL_SIGMA
from imaging.session.calibration import Response

WRONG = 0.25
"""Departure from a label, natural log, that no shutter has: the label is another photograph's."""
FEWEST = 60
"""Codes that two photographs must share to be compared."""


def departures(samples: Samples, response: Response, shift: dict[float, float]) -> Array:
    """Natural log of the exposure over label and shift, [S], of each photograph of one view.

    Most of a view's photographs are taken to be right. NaN if undecidable: of two photographs that contradict
    each other, and of those that share too few codes with the others.
    """
    departed = np.full(samples.codes.shape[1], np.nan)
    if not len(samples.codes):
        return departed
    moved = np.vectorize(lambda label: label + shift.get(round(float(label), 6), 0.0))(samples.log_k[0])
    codes = samples.codes / 255.0
    with np.errstate(divide="ignore"):
        light = np.log(decode(np.nan_to_num(codes, nan=0.5), response).astype(np.float64))
    light = np.where(np.isfinite(codes), light - moved[:, None], np.nan)
    pairs, rows, goals = [], [], []
    for first in range(len(departed)):
        for second in range(first):
            away = light[:, first] - light[:, second]
            away = away[np.isfinite(away)]
            if len(away) >= FEWEST:
                pairs.append((first, second))
                rows.append(np.eye(len(departed))[first] - np.eye(len(departed))[second])
                goals.append(float(np.median(away)))
    if not pairs:
        return departed
    graph = sparse.csr_array((np.ones(len(pairs)), np.array(pairs).T), (len(departed), len(departed)))
    part = connected_components(graph, directed=False)[1]
    together = part == np.bincount(part).argmax()
    if together.sum() < 3:
        return departed
    offset = np.linalg.lstsq(np.array(rows), np.array(goals))[0]
    from_each = offset[together][None] - offset[together][:, None]
    departed[together] = from_each[np.argmin(np.log1p((from_each / LABEL_SIGMA) ** 2).sum(1))]
    return departed

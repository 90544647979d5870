"""Selection of the pairs of views to match: all of few, of many those that look alike or stand together."""

from collections.abc import Collection, Mapping, Sequence
from itertools import combinations

import cv2
import numpy as np

from calib.data.matching import unit
from imaging.arrays import Array32, Bytes
from imaging.session.view_id import ViewId

ALL_PAIRS = 60
"""Views up to which every pair is matched."""
ALIKE = 10
"""Most alike views that each of more views is matched with (`bench/calibration/at_size/alike.py`)."""
NEIGHBOURS = 5
"""Frames before and after that the same camera is matched with."""
WORDS = 64
"""Centres that descriptors are summed up around."""
SAMPLE = 40_000
"""Descriptors, evenly from all views, that the centres are found from."""


def pairs_to_match(
    descriptors: Mapping[ViewId, Bytes], rigs: Sequence[Collection[str]]
) -> list[tuple[ViewId, ViewId]]:
    """Pairs of views in their order, each once.

    descriptors: of the features of each view, uint8 [K, 128]. rigs: names of cameras that are mounted to each
    other: of one frame they are all matched.
    """
    views = list(descriptors)
    every = list(combinations(range(len(views)), 2))
    if len(views) > ALL_PAIRS:
        chosen = _alike([unit(rows) for rows in descriptors.values()])
        chosen |= {pair for pair in every if _together(views[pair[0]], views[pair[1]], rigs)}
        every = sorted(chosen)
    return [(views[one], views[other]) for one, other in every]


def _together(one: ViewId, other: ViewId, rigs: Sequence[Collection[str]]) -> bool:
    if one.camera == other.camera:
        return abs(one.frame - other.frame) <= NEIGHBOURS
    return one.frame == other.frame and any(one.camera in rig and other.camera in rig for rig in rigs)


def _alike(descriptors: Sequence[Array32]) -> set[tuple[int, int]]:
    """Pairs of each view with those that look most like it."""
    signatures = _signatures(descriptors)
    likeness = signatures @ signatures.T
    np.fill_diagonal(likeness, -np.inf)
    nearest = np.argsort(-likeness, axis=1, kind="stable")[:, :ALIKE]
    return {
        (min(one, int(other)), max(one, int(other)))
        for one, row in enumerate(nearest)
        for other in row
        if len(descriptors[one]) and len(descriptors[int(other)])
    }


def _signatures(descriptors: Sequence[Array32]) -> Array32:
    """Signatures of the views' features, as unit vectors [views, WORDS * 128]; 0 without any.

    Residuals of descriptors from their nearest centre, summed up for each centre (VLAD: Jegou et al.,
    "Aggregating local descriptors into a compact image representation", 2010; normalised for each centre as
    in Arandjelovic and Zisserman, "All about VLAD", 2013).
    """
    share = max(SAMPLE // len(descriptors), 1)
    sample = np.concatenate([rows[:: max(len(rows) // share, 1)] for rows in descriptors])
    cv2.setRNGSeed(0)
    stop = (cv2.TERM_CRITERIA_COUNT, 15, 0.0)
    words = min(WORDS, len(sample))
    _, _, centres = cv2.kmeans(sample, words, None, stop, 1, cv2.KMEANS_PP_CENTERS)
    signatures = np.zeros((len(descriptors), words, sample.shape[1]), np.float32)
    for signature, rows in zip(signatures, descriptors, strict=True):
        nearest = np.argmax(rows @ centres.T - 0.5 * (centres**2).sum(axis=1), axis=1)
        np.add.at(signature, nearest, rows - centres[nearest])
        signature /= np.linalg.norm(signature, axis=1, keepdims=True) + 1e-9
    flat = signatures.reshape(len(descriptors), -1)
    return np.asarray(flat / (np.linalg.norm(flat, axis=1, keepdims=True) + 1e-9), np.float32)

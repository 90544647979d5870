"""Code values of the same scene points in views of different exposure: a response without any bracket.

Auto-exposed photographs, or one exposure a view, show no photosite twice; but a matte point has the same
radiance from everywhere, so matched features determine the curve as a bracket does, with more noise.
"""

from collections.abc import Mapping, Sequence
from itertools import combinations

import cv2
import numpy as np
from scipy import ndimage

from calib.data.features import FEWEST_MATCHES, Features, extract, unmasked
from calib.data.matching import match
from calib.data.previews import preview
from calib.data.views import View
from calib.light.curves.codes import CLIPPED, HIGHEST, LOWEST, Samples
from imaging.arrays import Array, Array32, Floats, Integers, Mask
from imaging.files.photo import read_photo
from imaging.merge.bracket import merge_bracket
from imaging.merge.linear_frame import from_codes
from imaging.merge.masks import mask_of
from imaging.progress import Progress
from imaging.session.calibration import Response
from imaging.session.session import Session

LEAST_SPAN = 2 * float(np.log(2.0))
"""Least span of ln k over the labels: over less, gloss and falloff bend the light more than a curve does."""
WIDEST = 640
"""px; wider photographs are reduced to it before features are found, of which a few thousand suffice."""
PATCH = 5
"""px, side of the square around a feature that is averaged; of pictures of 640 px or narrower."""
MOST_PAIRS = 1500
"""Pairs of views that are matched; of more, those nearest in order, which are mostly neighbours."""
CELLS = 4
"""Rows and columns of cells, of the view that saw them first, by which features are held out."""
GUESS = Response(kind="srgb", evidence="to find features by")


def sample_tracks(
    session: Session, views: Sequence[View], labels: Mapping[str, float], progress: Progress
) -> Samples | None:
    """Points that views of different exposure share, as samples.

    Args:
        session: Session of the views.
        views: Views of cameras that develop their photographs. Of a view with several exposures the middle
            one counts; views without exposure data are passed over.
        labels: Exposure scale of each file, s.
        progress: Callback for the current step, the steps done, and all of them.

    Returns:
        Samples; None where the labels hardly differ, or views share no point.

    Raises:
        InputError: A photograph or a mask is missing or damaged.
    """
    shots = {
        view.id: sorted(view.shots, key=lambda shot: labels[shot.file])[len(view.shots) // 2]
        for view in views
        if all(shot.exposure is not None for shot in view.shots)
    }
    logs = {key: float(np.log(labels[shot.file])) for key, shot in shots.items()}
    if len(logs) < 2 or max(logs.values()) - min(logs.values()) < LEAST_SPAN:
        return None
    features: list[Features] = []
    codes: list[Array] = []
    cells: list[Integers] = []
    for done, shot in enumerate(shots.values()):
        progress("finding points that views share", done, len(shots))
        pixels = np.ascontiguousarray(read_photo(session.file(shot)).pixels, np.float32)
        small = _reduced(pixels)
        picture = preview(merge_bracket([from_codes(small, labels[shot.file], GUESS)]))
        height, width = picture.shape
        extracted = extract(picture)
        counts = mask_of(session, shot, *pixels.shape[:2])
        if counts is not None:
            extracted = unmasked(extracted, counts, width, height)
        features.append(extracted)
        codes.append(_codes_at(pixels, extracted.points * pixels.shape[1] / width, counts))
        column, row = np.clip(extracted.points * CELLS / (width, height), 0, CELLS - 1).astype(np.int64).T
        cells.append((len(cells) * CELLS + row) * CELLS + column)
    tracks = _tracks(features, progress)
    if not tracks:
        return None
    longest = max(len(track) for track in tracks)
    track_codes = np.full((len(tracks), longest, 3), np.nan)
    log_k = np.full((len(tracks), longest), min(logs.values()))
    group = np.zeros(len(tracks), np.int64)
    every = list(logs.values())
    for index, track in enumerate(tracks):
        for place, (view, feature) in enumerate(track):
            track_codes[index, place] = codes[view][feature]
            log_k[index, place] = every[view]
        group[index] = cells[track[0][0]][track[0][1]]
    return Samples(track_codes, log_k, np.unique(group, return_inverse=True)[1], rough=True)


def _reduced(pixels: Array32) -> Array32:
    height, width = pixels.shape[:2]
    if width <= WIDEST:
        return pixels
    size = (WIDEST, max(1, round(height * WIDEST / width)))
    return np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA), np.float32)


def _codes_at(pixels: Array32, points: Array, counts: Mask | None = None) -> Array:
    """Mean codes [K, 3], 0..255, around points; NaN where any of them is clipped or too near an end.

    counts: bool [H, W], which pixels a mask lets through; a point that has another around it gets NaN.
    """
    size = PATCH * max(1, round(pixels.shape[1] / WIDEST))
    size += 1 - size % 2
    scaled = 255.0 * pixels
    rows = np.clip(points[:, 1].astype(int), 0, pixels.shape[0] - 1)
    columns = np.clip(points[:, 0].astype(int), 0, pixels.shape[1] - 1)
    unmasked_there = None if counts is None else ndimage.minimum_filter(counts, size)[rows, columns]
    codes = np.empty((len(points), 3))
    for channel in range(3):
        plane = scaled[..., channel]
        mean = ndimage.uniform_filter(plane, size)[rows, columns]
        low = ndimage.minimum_filter(plane, size)[rows, columns]
        high = ndimage.maximum_filter(plane, size)[rows, columns]
        inside = (mean >= LOWEST) & (low >= CLIPPED[0]) & (mean <= HIGHEST) & (high <= CLIPPED[1])
        codes[:, channel] = np.where(
            inside if unmasked_there is None else inside & unmasked_there, mean, np.nan
        )
    return codes


def _agreeing(one: Floats, other: Floats) -> Mask:
    """Return which matches [M] between points [M, 2] px of two pictures agree with one geometry of both."""
    try:
        _, mask = cv2.findFundamentalMat(one, other, cv2.USAC_MAGSAC, 1.0, 0.999, 2000)
    except cv2.error:  # OpenCV 5 asserts on good matches too, depending on their order
        _, mask = cv2.findFundamentalMat(one, other, cv2.FM_RANSAC, 1.0, 0.999, 2000)
    return np.zeros(len(one), bool) if mask is None else mask.ravel() > 0


def _tracks(features: Sequence[Features], progress: Progress) -> list[list[tuple[int, int]]]:
    """Features of several views that are one point: lists of (view, feature), one feature a view."""
    first = np.cumsum([0, *(len(of_view.points) for of_view in features)])
    parent = np.arange(first[-1])

    def root(node: int) -> int:
        while parent[node] != node:
            parent[node] = parent[parent[node]]
            node = int(parent[node])
        return node

    pairs = sorted(combinations(range(len(features)), 2), key=lambda pair: pair[1] - pair[0])[:MOST_PAIRS]
    cv2.setRNGSeed(0)
    for done, (a, b) in enumerate(pairs):
        progress("matching", done, len(pairs))
        matches = match(features[a].descriptors, features[b].descriptors).astype(int)
        if len(matches) < FEWEST_MATCHES:
            continue
        one, other = features[a].points[matches[:, 0]], features[b].points[matches[:, 1]]
        agreeing = _agreeing(one, other)
        if int(agreeing.sum()) < FEWEST_MATCHES:
            continue
        for i, j in matches[agreeing]:
            parent[root(int(first[a] + i))] = root(int(first[b] + j))
    progress("matching", len(pairs), len(pairs))
    members: dict[int, list[tuple[int, int]]] = {}
    for view, of_view in enumerate(features):
        for index in range(len(of_view.points)):
            members.setdefault(root(int(first[view] + index)), []).append((view, index))
    return [
        track
        for track in members.values()
        if len(track) >= 2 and len({view for view, _ in track}) == len(track)
    ]

"""Pairs of views that contradict a model: their matches fit an epipolar geometry of their own, not the
model's.

A scene whose sides look alike is folded: views of one side are placed before another, and the points of both
fit. Where the fold ends, though, two neighbours match that the model sets apart.
"""

from collections.abc import Collection, Mapping
from statistics import median
from typing import Any

import numpy as np

from calib.data.features import MatchedPair
from calib.poses.checks.brightness_steps import Pairs
from imaging.arrays import Array, Mask
from imaging.session.view_id import ViewId

FEWEST_AGAINST = 30
"""Matches of a pair that do not fit the model, below which they may be chance."""
SUPPORTED = 0.5
"""Share of a pair's matches that fit the model, below which the pair contradicts it."""
STRONG = 0.5
"""Ratio of its matches to those of the best pair that supports a view's pose above which a pair is strong."""


def contradicting(reconstruction: Any, pairs: Pairs, max_error: float) -> dict[tuple[ViewId, ViewId], int]:
    """Pairs of registered views that contradict their poses, and how many matches of each do."""
    placed = placed_views(reconstruction)
    counts = {}
    for (one, other), pair in pairs.items():
        if one in placed and other in placed:
            fits = fits_of(placed[one], placed[other], pair, max_error)
            if len(fits) - fits.sum() >= FEWEST_AGAINST and fits.mean() < SUPPORTED:
                counts[one, other] = int(len(fits) - fits.sum())
    return counts


def fitting(reconstruction: Any, pairs: Pairs, max_error: float) -> tuple[int, int]:
    """Count the pairs of registered views that fit their poses, and all pairs of registered views."""
    placed = placed_views(reconstruction)
    shares = [
        float(fits_of(placed[one], placed[other], pair, max_error).mean())
        for (one, other), pair in pairs.items()
        if one in placed and other in placed
    ]
    return sum(share >= SUPPORTED for share in shares), len(shares)


def well_matched(pairs: Pairs, placed: Collection[ViewId]) -> float:
    """The matches from which on a pair is as good as those that placed views have with each other."""
    best = _best(pairs, placed)
    usual = median(best.values()) if best else 0
    return max(STRONG * usual, 2 * FEWEST_AGAINST)


def shut_out(reconstruction: Any, pairs: Pairs) -> set[ViewId]:
    """The views without a pose that match placed ones as well as these match each other."""
    placed = placed_views(reconstruction)
    least = well_matched(pairs, placed)
    return {
        view
        for (one, other), pair in pairs.items()
        for view, beside in ((one, other), (other, one))
        if view not in placed and beside in placed and len(pair.one) >= least
    }


def _best(pairs: Pairs, placed: Collection[ViewId]) -> dict[ViewId, int]:
    """Most matches that each registered view shares with another."""
    best: dict[ViewId, int] = {}
    for (one, other), pair in pairs.items():
        if one in placed and other in placed:
            best[one] = max(best.get(one, 0), len(pair.one))
            best[other] = max(best.get(other, 0), len(pair.one))
    return best


def strong(reconstruction: Any, pairs: Pairs, against: Mapping[tuple[ViewId, ViewId], int]) -> bool:
    """Return whether a pair contradicts the poses with as many matches as those that support its views."""
    holding = {pair: matches for pair, matches in pairs.items() if pair not in against}
    best = _best(holding, placed_views(reconstruction))
    return any(
        count >= STRONG * min(best.get(one, 0), best.get(other, 0)) for (one, other), count in against.items()
    )


def placed_views(reconstruction: Any) -> dict[ViewId, tuple[Any, Array]]:
    """Camera and cam_from_world [4, 4] of every view that has a pose."""
    placed = {}
    for index in sorted(reconstruction.reg_image_ids()):
        image = reconstruction.image(index)
        pose = np.vstack([image.cam_from_world().matrix(), [0.0, 0.0, 0.0, 1.0]])
        placed[ViewId.of_image(image.name)] = reconstruction.cameras[image.camera_id], pose
    return placed


def fits_of(one: tuple[Any, Array], other: tuple[Any, Array], pair: MatchedPair, max_error: float) -> Mask:
    """Mask [M] of the matches that lie within `max_error` px of their epipolar lines (Sampson's distance)."""
    pose = other[1] @ np.linalg.inv(one[1])
    x, y, z = pose[:3, 3]
    essential = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ pose[:3, :3]
    here, there = (
        np.column_stack([camera.cam_from_img(points), np.ones(len(points))])
        for (camera, _), points in ((one, pair.one), (other, pair.other))
    )
    line, back = here @ essential.T, there @ essential
    slope = np.sqrt((line[:, :2] ** 2).sum(1) + (back[:, :2] ** 2).sum(1))
    focal = 0.5 * (one[0].mean_focal_length() + other[0].mean_focal_length())
    return np.asarray(np.abs((there * line).sum(1)) * focal <= max_error * np.maximum(slope, 1e-12))


def most_doubtful(
    reconstruction: Any, pairs: Pairs, against: Mapping[tuple[ViewId, ViewId], int]
) -> tuple[ViewId, float]:
    """The view with the largest share of its matches in pairs that contradict the model, and the share."""
    placed = placed_views(reconstruction)
    doubted, every = dict.fromkeys(placed, 0), dict.fromkeys(placed, 0)
    for (one, other), pair in pairs.items():
        if one in placed and other in placed:
            for view in (one, other):
                every[view] += len(pair.one)
                doubted[view] += len(pair.one) * ((one, other) in against)
    shares = {view: doubted[view] / max(every[view], 1) for view in placed}
    worst = max(shares, key=shares.__getitem__)
    return worst, shares[worst]

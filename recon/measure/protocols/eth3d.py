"""COLMAP's measure of poses (`benchmark/reconstruction/evaluation/utils.py`, `relative_auc`), for ETH3D.

Of each ordered pair of images the rotation between them and the direction from one to the other are compared
with the truth's, and the larger angle counts. A pair of which an image is not placed, or is not in the truth,
counts 180 degrees. The figure is the area below the share of pairs within an angle, up to a threshold.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from imaging.arrays import Array
from imaging.session.calibration import read_calibration
from imaging.session.session import Session

THRESHOLDS = (0.5, 1.0, 5.0, 10.0)
"""Degrees."""
ACCURACY = 0.001
"""Accuracy of the truth: centres nearer than that, m, have no direction; below it, degrees, all is right."""
WORST = 180.0
"""Degrees."""


def measure(estimated: Mapping[str, Array], true: Mapping[str, Array]) -> dict[str, float]:
    """Score poses `cam_from_world` [4, 4] by image name: `placed` (percent) and `auc_T` for each threshold.

    true: in metres.
    """
    errors = relative_errors(estimated, true)
    placed = 100 * len(estimated.keys() & true.keys()) / len(true)
    areas = zip(THRESHOLDS, areas_below(errors, THRESHOLDS), strict=True)
    return {"placed": placed} | {f"auc_{threshold:g}": area for threshold, area in areas}


def placed_images(session: Path) -> dict[str, Array]:
    """Poses of a calibrated session, by `folder/file` of the photographs that it was imported from."""
    opened = Session.open(session)
    poses = {view.id: view.cam_from_world.matrix() for view in read_calibration(session).views}
    return {
        name_of(shot.source or shot.file): poses[shot.view]
        for shot in opened.shots("scene")
        if shot.view in poses
    }


def name_of(path: str) -> str:
    """The last folder and the file of a path, by which ETH3D's model names an image."""
    return "/".join(Path(path).parts[-2:])


def relative_errors(estimated: Mapping[str, Array], true: Mapping[str, Array]) -> Array:
    """Degrees of every ordered pair of images that the truth or the estimate has."""
    common = sorted(estimated.keys() & true.keys())
    ours, theirs = (np.array([poses[name] for name in common]) for poses in (estimated, true))
    measured = [_errors_from(number, ours, theirs) for number in range(len(common))]
    pairs = len(common) * (len(common) - 1)
    lost = len(true) * (len(true) - 1) + len(estimated) * (len(estimated) - 1) - 2 * pairs
    return np.concatenate([*measured, np.full(lost, WORST)])


def _errors_from(source: int, ours: Array, theirs: Array) -> Array:
    """Degrees of the pairs from one image to each of the others."""
    others = np.arange(len(ours)) != source
    turns, moves = zip(*(_relative(poses[source], poses[others]) for poses in (ours, theirs)), strict=True)
    traces = np.einsum("nij,nij->n", *turns)
    turned = _degrees((traces - 1) / 2)
    lengths = [np.linalg.norm(move, axis=1) for move in moves]
    cosines = np.einsum("ni,ni->n", *moves) / np.maximum(lengths[0] * lengths[1], 1e-20)
    moved = np.where(lengths[1] < ACCURACY, 0.0, _degrees(cosines))
    return np.asarray(np.maximum(turned, moved))


def _relative(source: Array, targets: Array) -> tuple[Array, Array]:
    """Rotations [N, 3, 3] and translations [N, 3] from one camera to others."""
    turn = targets[:, :3, :3] @ source[:3, :3].T
    return turn, targets[:, :3, 3] - turn @ source[:3, 3]


def _degrees(cosines: Array) -> Array:
    return np.asarray(np.rad2deg(np.arccos(np.clip(cosines, -1, 1))))


def areas_below(errors: Array, thresholds: Sequence[float]) -> list[float]:
    """Percent of the area below the share of errors within an angle, from 0 to each threshold."""
    ordered = np.sort(errors)
    shares = np.arange(1, len(ordered) + 1) / len(ordered)
    sure = int((ordered <= ACCURACY).sum())
    angles = np.concatenate([[0.0, ACCURACY], ordered[sure:]])
    shares = np.concatenate([np.full(2, sure / len(ordered)), shares[sure:]])
    areas = []
    for threshold in thresholds:
        last = int((angles <= threshold).sum())
        within = np.append(angles[:last], threshold), np.append(shares[:last], shares[last - 1])
        areas.append(float(100 * np.trapezoid(within[1], within[0]) / threshold))
    return areas

"""Errors of poses: between pairs of views, and in the stated standard errors."""

from collections.abc import Mapping, Sequence
from itertools import combinations
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from imaging.arrays import Array
from imaging.files import store
from imaging.optics.pose import Pose
from imaging.session.calibration import CalibrationRecord
from imaging.session.view_id import ViewId

Name = TypeVar("Name", ViewId, str)
"""Key of a view."""

INSIDE = 2.8
"""Standard errors of the worst axis within which 95 % of vectors lie that err alike along three axes (the
95 % point of chi with 3 degrees of freedom is 2.796); more lie within them where one axis is the worst."""


def true_poses(session: Path) -> dict[ViewId, Array]:
    """cam_from_world [4, 4] of every view of a simulated session."""
    truth = store.read_json(session / "truth" / "truth.json")
    return {
        ViewId(entry["frame"], camera): Pose.model_validate(pose).matrix()
        for entry in truth["frames"]
        for camera, pose in entry["cam_from_world"].items()
    }


def found_poses(record: CalibrationRecord) -> dict[ViewId, Array]:
    """The same of the views that were placed."""
    return {view.id: view.cam_from_world.matrix() for view in record.views}


def degrees_of(rotation: Array) -> float:
    """Angle of a rotation [3, 3]; exact for small ones too, where its cosine is not."""
    sine = np.linalg.norm(rotation - rotation.T) / np.sqrt(8)
    return float(np.degrees(np.arctan2(sine, (np.trace(rotation) - 1) / 2)))


def pairs(estimated: Mapping[Name, Array], true: Mapping[Name, Array]) -> Array:
    """Errors [pairs, 2], degrees, of every pair of true views: its rotation, and its translation's direction.

    inf for the pairs of a view that was not placed. Pairs that stand at one place have no direction.
    """
    errors = []
    for view, other in combinations(sorted(true), 2):
        goal = true[view] @ np.linalg.inv(true[other])
        if view not in estimated or other not in estimated:
            errors.append((np.inf, np.inf))
            continue
        relative = estimated[view] @ np.linalg.inv(estimated[other])
        turn = degrees_of(relative[:3, :3] @ goal[:3, :3].T)
        here, there = relative[:3, 3], goal[:3, 3]
        angle = 0.0
        if np.linalg.norm(there) > 1e-9:
            angle = float(np.degrees(np.arctan2(np.linalg.norm(np.cross(here, there)), here @ there)))
        errors.append((turn, angle))
    return np.array(errors)


def auc(errors: Array, threshold: float) -> float:
    """Area under the share of pairs whose larger error is below x, for x from 0 to the threshold, 0 to 1.

    As of the Image Matching Challenge (Jin et al., "Image Matching across Wide Baselines", 2021), exactly
    and not by bins.
    """
    return float(np.clip(1 - errors.max(1) / threshold, 0, 1).mean())


def aligned(
    estimated: Mapping[ViewId, Array], true: Mapping[ViewId, Array]
) -> tuple[list[ViewId], Array, Array, float]:
    """The views that both have; rotation vectors, degrees [V, 3], and shifts of the centres [V, 3] after the
    best similarity (its turn by the mean of the orientations), in units of the truth; and its scale."""
    views = sorted(estimated.keys() & true.keys())
    estimates, goal = (np.stack([poses[view] for view in views]) for poses in (estimated, true))
    u, _, vt = np.linalg.svd(np.einsum("nji,njk->ik", goal[:, :3, :3], estimates[:, :3, :3]))
    turn = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    apart = estimates[:, :3, :3] @ turn.T @ goal[:, :3, :3].transpose(0, 2, 1)
    skew = (apart - apart.transpose(0, 2, 1)) / 2
    turns = np.degrees(np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1))
    here, there = (-np.einsum("nji,nj->ni", poses[:, :3, :3], poses[:, :3, 3]) for poses in (estimates, goal))
    here, middle = (here - here.mean(0)) @ turn.T, there.mean(0)
    size = float((here**2).sum())
    scale = float((here * (there - middle)).sum()) / size if size > 0 else 1.0
    return views, turns, scale * here + middle - there, scale


def of_session(session: Path, record: CalibrationRecord) -> dict[str, Any]:
    """A row: AUCs, median errors and how many of the stated intervals hold the truth."""
    true, estimated = true_poses(session), found_poses(record)
    errors = pairs(estimated, true)
    views, turns, shifts, scale = aligned(estimated, true)
    stated = {view.id: view.error for view in record.views}
    rotation, translation = [], []
    for view, turn, shift in zip(views, turns, shifts, strict=True):
        error = stated[view]
        if error is not None:
            rotation.append(float(np.linalg.norm(turn)) / error.rotation)
            translation.append(float(np.linalg.norm(shift)) / (scale * error.translation))
    placed = errors[np.isfinite(errors[:, 0])]
    return {
        "registered": len(estimated),
        "views": len(true),
        **{f"auc_{threshold}": auc(errors, threshold) for threshold in (1, 3, 5)},
        "rotation": float(np.median(placed[:, 0])),
        "direction": float(np.median(placed[:, 1])),
        "rotation_ratios": rotation,
        "translation_ratios": translation,
    }


def covered(ratios: Sequence[float]) -> float | None:
    """Share of errors that their 95 % interval holds."""
    return float(np.mean(np.array(ratios) < INSIDE)) if len(ratios) else None

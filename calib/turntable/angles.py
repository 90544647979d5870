"""Stated angles of a turntable against the poses: how far they differ, and poses that follow from them."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from math import hypot, radians

import numpy as np
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

from calib.poses.sfm import SceneModel, pose_of
from imaging.and_list import and_more
from imaging.arrays import Array
from imaging.files.colmap import pycolmap
from imaging.session.records import Rung
from imaging.session.turntable import TurntableRecord
from imaging.session.view_id import ViewId

STATED, PLACED = "turntable_angles", "turntable_placing"
FEWEST = 3
"""Views of a camera with poses that show an axis."""
LEAST_TURN = 5.0
"""Degrees that stated angles span at least, for the axis to be seen."""
BEYOND = 4.0
"""Stated standard errors, of the angles' rms difference, beyond which they are not those of the pictures."""
MOST_NAMES = 6
ROUGH = 0.05
"""Degrees of an error that no statement of angles is held against: that of the poses."""


@dataclass(frozen=True, eq=False)
class Axis:
    """Axis of a turntable in the world of the poses.

    direction: unit, about which stated angles turn the world counterclockwise. place: [3], a point on it.
    differences: of each view's turn from the stated one, degrees, about zero for each camera.
    """

    direction: Array
    place: Array
    differences: Mapping[ViewId, float]

    @property
    def rms(self) -> float:
        """Difference of turns from the stated ones, degrees."""
        return float(np.sqrt(np.mean(np.square(list(self.differences.values())))))


def with_angles(model: SceneModel, views: Collection[ViewId], turntable: TurntableRecord) -> SceneModel:
    """The model with a rung on its turns, and a pose for each view that has none and a stated angle.

    Such a view stands where the placed view of its camera at the nearest angle does, turned about the axis;
    it has no scene points, and its standard error is that of the other and of the angle. Where stated and
    estimated turns differ by more than is stated, no pose follows from them.

    Args:
        model: Poses of the views that features place.
        views: All views.
        turntable: Stated angles.
    """
    axis = axis_of(model, turntable)
    if axis is None:
        reason = f"fewer than {FEWEST} views of each camera have poses and stated angles that show an axis"
        return replace(model, rungs=(*model.rungs, Rung(name=STATED, taken=False, reason=reason)))
    worst = max(axis.differences, key=lambda view: abs(axis.differences[view]))
    agree = axis.rms <= BEYOND * hypot(turntable.spread, ROUGH)
    reason = (
        f"{turntable.reason} states angles to {turntable.spread:g} degrees, and the turns of "
        f"{len(axis.differences)} views differ from these by {axis.rms:.2f} (rms), {worst} by "
        f"{axis.differences[worst]:+.2f}"
    )
    if not agree:
        reason += ": no pose follows from an angle; correct turntable.json"
    model = replace(model, rungs=(*model.rungs, Rung(name=STATED, taken=agree, reason=reason)))
    return _with_poses(model, sorted(set(views) - set(model.poses)), turntable, axis) if agree else model


def axis_of(model: SceneModel, turntable: TurntableRecord) -> Axis | None:
    """The axis about which the poses turn, in either direction of stated angles; None if none shows."""
    by_camera: dict[str, list[ViewId]] = {}
    for view in sorted(model.poses):
        if view.frame in turntable.degrees:
            by_camera.setdefault(view.camera, []).append(view)
    groups = [
        views
        for views in by_camera.values()
        if len(views) >= FEWEST and np.ptp([turntable.degrees[view.frame] for view in views]) > LEAST_TURN
    ]
    if not groups:
        return None
    motions = [np.stack([model.poses[view].matrix() for view in views]) for views in groups]
    # A still camera sees the axis alike at all stops: its direction, and its points.
    spread = sum(
        np.einsum("nij,nik->jk", part - part.mean(axis=0), part - part.mean(axis=0))
        for part in (group[:, :3, :3] for group in motions)
    )
    direction = np.linalg.eigh(np.asarray(spread))[1][:, 0]
    fits = [
        [
            _differences(group[:, :3, :3], side * direction, _stated(views, turntable))
            for views, group in zip(groups, motions, strict=True)
        ]
        for side in (1.0, -1.0)
    ]
    side = int(np.argmin([sum(float(np.square(part).sum()) for part in fit) for fit in fits]))
    differences = {
        view: float(one)
        for views, part in zip(groups, fits[side], strict=True)
        for view, one in zip(views, part, strict=True)
    }
    return Axis(direction * (1.0, -1.0)[side], _place(motions), differences)


def _stated(views: Sequence[ViewId], turntable: TurntableRecord) -> Array:
    return np.array([turntable.degrees[view.frame] for view in views])


def _differences(rotations: Array, direction: Array, stated: Array) -> Array:
    """Differences of the turns of one camera's views [N, 3, 3] from the stated [N], degrees, about zero."""
    turns = rotations[0].T @ rotations
    skew = np.stack([turns[:, i, j] - turns[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))], axis=1)
    angles = np.arctan2(skew @ direction, np.trace(turns, axis1=1, axis2=2) - 1.0) - np.radians(stated)
    mean = np.angle(np.exp(1j * angles).mean())
    return np.asarray(np.degrees(np.angle(np.exp(1j * (angles - mean)))))


def _place(motions: Sequence[Array]) -> Array:
    """The point on the axis that is nearest to the origin, by the motions [N, 4, 4] of each camera."""
    rows = np.concatenate([group[:, :3, :3].reshape(-1, 3) for group in motions])
    still = [np.tile(np.eye(3), (len(group), 1)) for group in motions]
    shifts = np.concatenate([group[:, :3, 3].ravel() for group in motions])
    solution = np.linalg.lstsq(np.column_stack([rows, -block_diag(*still)]), -shifts, rcond=1e-6)[0]
    return np.asarray(solution[:3])


def _with_poses(
    model: SceneModel, lost: Sequence[ViewId], turntable: TurntableRecord, axis: Axis
) -> SceneModel:
    poses, points = dict(model.poses), dict(model.points)
    turns = {} if model.errors is None else dict(model.errors.rotation)
    shifts = {} if model.errors is None else dict(model.errors.translation)
    placed = []
    for view in lost:
        beside = [other for other in axis.differences if other.camera == view.camera]
        if not beside or view.frame not in turntable.degrees:
            continue

        def further(other: ViewId, frame: int = view.frame) -> float:
            return turntable.degrees[frame] - turntable.degrees[other.frame]

        nearest = min(beside, key=lambda other: abs((further(other) + 180.0) % 360.0 - 180.0))
        # The nearest view stands off its stop by what was estimated.
        angle = radians(further(nearest) - axis.differences[nearest])
        turn = np.eye(4)
        turn[:3, :3] = Rotation.from_rotvec(angle * axis.direction).as_matrix()
        turn[:3, 3] = axis.place - turn[:3, :3] @ axis.place
        poses[view] = pose_of(pycolmap.Rigid3d((model.poses[nearest].matrix() @ turn)[:3]))
        points[view] = 0
        placed.append(str(view))
        if model.errors is not None:
            motion = poses[view].matrix()
            centre = -motion[:3, :3].T @ motion[:3, 3]
            arm = float(np.linalg.norm(np.cross(centre - axis.place, axis.direction)))
            turns[view] = hypot(turns[nearest], turntable.spread)
            shifts[view] = hypot(shifts[nearest], arm * radians(turntable.spread))
    if not placed:
        return model
    errors = model.errors and replace(model.errors, rotation=turns, translation=shifts)
    names = and_more(placed, MOST_NAMES)
    reason = f"no scene point in {names} was used: the pose follows from the stated angle of the turntable"
    rungs = (*model.rungs, Rung(name=PLACED, taken=True, reason=reason))
    return replace(model, poses=poses, points=points, errors=errors, rungs=rungs)

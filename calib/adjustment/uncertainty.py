"""Uncertainty of poses and lenses by a wild bootstrap over scene points.

To first order an estimate moves by H^-1 times the sum of what each point pulls; points drawn with random
signs then move it as another set of points would (the wild bootstrap: Wu, "Jackknife, Bootstrap and Other
Resampling Methods in Regression Analysis", 1986). Points that lie together in the pictures pull together:
SIFT finds one corner at several sizes and turns, and errs alike in all of them. The middle of the image, a
second radial and the tangential terms are free meanwhile, whatever the ladder took: that a term is too small
to be seen makes what it trades places with no surer. How lenses are built bounds those.

The step from the chosen lens to the one with all of these terms counts as an error of the choice, with a
random sign in each draw, and so does that to the lens without the terms that weak evidence added. Of
photographs of buildings whose cameras were measured by laser, noise alone stated a half to a ninth of the
true errors of their centres; with both steps these are 0.3 to 0.9 times the stated ones
(`bench/real/poses/laser.py`).
"""

from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from scipy import sparse

from calib.adjustment.bundle_adjustment import Free, is_fisheye
from calib.adjustment.drawn_lenses import bounded, move_without
from calib.adjustment.focal_priors import HOLDS
from calib.adjustment.jacobian import Linear, is_reference, linearise
from calib.adjustment.place_priors import variance as variance_of_place
from calib.adjustment.reduced_curvature import built_terms, reduced
from imaging.arrays import Array, Integers
from imaging.optics.lens import BROWN_TERMS, FISHEYE_TERMS
from imaging.progress import Progress
from imaging.session.view_id import ViewId

DRAWS = 100
FEWEST_POINTS = 60
CELLS = 20
"""Across a picture; points that are first seen in the same cell of it err together."""
FEWEST_OBSERVATIONS = 6
"""Points that a frame has to see for a stated error: of two or three the pose follows so closely that no
residual is left to say how sure it is."""
_RIDGE = 1e-9
"""Ridge relative to the diagonal: it holds the origin, the rotation and the scale of the world, which no
point determines.
"""


@dataclass(frozen=True)
class StandardErrors:
    """Standard errors of poses and lenses.

    rotation: degrees, and translation: in units of the model, of each view, about and along its worst axis;
    not of a view whose frame sees fewer than FEWEST_OBSERVATIONS points and has no stated place. lenses: by
    camera and term, in the pixels of the model. mounted: the same two of each camera in its rig, the
    reference excepted.
    """

    rotation: dict[ViewId, float]
    translation: dict[ViewId, float]
    lenses: dict[str, dict[str, float]]
    mounted: dict[str, tuple[float, float]]

    def without_lenses(self, cameras: Collection[str]) -> "StandardErrors":
        """The same where nothing was measured of these cameras' lenses."""
        return replace(
            self, lenses={name: errors for name, errors in self.lenses.items() if name not in cameras}
        )


def standard_errors(
    reconstruction: Any, free: Free, scale: float, progress: Progress, weak: Collection[str] = ()
) -> StandardErrors | None:
    """Draw the model anew, DRAWS times. Changes nothing.

    Args:
        reconstruction: pycolmap's, adjusted.
        free: Settings with which it was adjusted; what is fixed in them stays fixed.
        scale: Typical miss of an observation, px, on which the scale of the Cauchy loss depends.
        progress: Callback for the current step, the steps done, and all of them.
        weak: Terms of the lenses that were taken on weak evidence.

    Returns:
        Standard errors of poses and lenses; None when there are too few points.
    """
    if reconstruction.num_points3D() < FEWEST_POINTS:
        return None
    progress("measuring how sure it is", 0, 1)
    linear = linearise(reconstruction, free)
    moves = drawn_moves(linear, reconstruction, free, scale, weak)
    turns, shifts = drawn_poses(reconstruction, linear, moves)
    for view in _hardly_seen(reconstruction, free):
        del turns[view], shifts[view]
    names = {
        reconstruction.image(index).camera_id: ViewId.of_image(reconstruction.image(index).name).camera
        for index in reconstruction.reg_image_ids()
    }
    lenses = {}
    for number, name in sorted(names.items()):
        terms = FISHEYE_TERMS if is_fisheye(reconstruction.cameras[number]) else BROWN_TERMS
        errors = np.zeros(len(terms))
        if number in linear.lenses:
            errors = np.sqrt(np.mean(moves[:, linear.lenses[number] :][:, : len(terms)] ** 2, axis=0))
            errors[1] = errors[1] if free.model in ("OPENCV", "OPENCV_FISHEYE") else errors[0]
        lenses[name] = dict(zip(terms, errors.tolist(), strict=True))
    progress("measuring how sure it is", 1, 1)
    return StandardErrors(
        rotation={view: float(np.degrees(_widest(covariance))) for view, covariance in turns.items()},
        translation={view: _widest(covariance) for view, covariance in shifts.items()},
        lenses=lenses,
        mounted={
            names[number]: (
                float(np.degrees(_widest(list(moves[:, at : at + 3])))),
                _widest(list(moves[:, at + 3 : at + 6])),
            )
            for number, at in linear.sensors.items()
        },
    )


def drawn_poses(
    reconstruction: Any, linear: Linear, moves: Array
) -> tuple[dict[ViewId, list[Array]], dict[ViewId, list[Array]]]:
    """Rotation [3], rad, and translation [3] of each view under each of the drawn changes."""
    whole = _poses(reconstruction)
    turns: dict[ViewId, list[Array]] = {view: [] for view in whole}
    shifts: dict[ViewId, list[Array]] = {view: [] for view in whole}
    for move in moves:
        for view, pose in _aligned(_moved(reconstruction, linear, move), whole).items():
            turns[view].append(_turned((pose @ np.linalg.inv(whole[view]))[:3, :3]))
            shifts[view].append(centre_of(pose) - centre_of(whole[view]))
    return turns, shifts


def drawn_moves(
    linear: Linear, reconstruction: Any, free: Free, scale: float, weak: Collection[str] = ()
) -> Array:
    """Drawn changes of all parameters of the cameras, [DRAWS, P]."""
    part = reduced(linear, scale)
    curvature, inverse, shared, variance = part.curvature, part.inverse, part.shared, part.variance
    count, many = len(linear.residual), int(linear.owner.max()) + 1
    group = _groups(linear, many)
    groups = int(group.max()) + 1
    drawn = (part.pull[:, None] * linear.residual).ravel()
    summed = sparse.csr_matrix(
        (drawn, (np.repeat(group[linear.owner], 2), np.arange(2 * count))), shape=(groups, 2 * count)
    )
    eliminated = sparse.csr_matrix(
        (inverse @ (part.points.T @ drawn), (np.repeat(group, 3), np.arange(3 * many))),
        shape=(groups, 3 * many),
    )
    pulls = summed @ linear.cameras - eliminated @ shared.T
    # What a fit follows, its residuals do not show.
    spare = 2 * count - 3 * many
    more = np.sqrt(spare / max(spare - len(curvature), 0.1 * spare) * groups / max(groups - 1, 1))

    columns, errors, held = built_terms(linear, reconstruction, free)
    precision = variance / errors**2 * np.where(held, HOLDS**2, 1.0)
    curvature[columns, columns] += precision
    stated, weights = _stated(linear, reconstruction, free, scale)
    curvature += stated @ stated.T
    size = np.sqrt(np.diag(curvature))
    size[size == 0] = 1.0
    curvature = curvature / size / size[:, None] + _RIDGE * np.eye(len(size))
    drawings = (DRAWS, groups + len(columns) + stated.shape[1])
    signs = np.random.default_rng(0).choice([-1.0, 1.0], drawings)
    point_signs, built, stated_signs = np.split(signs, [groups, groups + len(columns)], axis=1)
    # Pulls less their mean, and never as a table: groups times parameters grow by the square of the views.
    drawn = more * (
        (pulls.T @ point_signs.T).T - point_signs.sum(1)[:, None] * np.asarray(pulls.mean(0)).ravel()
    )
    drawn[:, columns] += built * (precision * errors)
    drawn += stated_signs * np.sqrt(weights) @ stated.T
    moves = np.asarray(np.linalg.solve(curvature, (drawn / size).T).T)
    moves = bounded(moves, curvature, columns, errors * size[columns]) / size
    # All points together pull at the terms that the ladder did not take; the pull at the others is balanced.
    further = ~np.isin(columns, list(linear.lenses.values()))  # a lens begins with its focal length
    pull = np.zeros(len(size))
    pull[columns[further]] = np.asarray(pulls.sum(0)).ravel()[columns[further]]
    step = np.linalg.solve(curvature, pull / size) / size
    farthest = np.max(np.abs(step[columns[further]]) / errors[further], initial=0.0)
    signs = np.random.default_rng(1).choice([-1.0, 1.0], (2, DRAWS, 1))
    back = move_without(linear, reconstruction, curvature, size, weak)
    return np.asarray(moves + signs[0] * step / max(farthest, 1.0) + signs[1] * back)


def _hardly_seen(reconstruction: Any, free: Free) -> list[ViewId]:
    """Views whose pose no residual can say the error of."""
    images = [reconstruction.image(number) for number in reconstruction.reg_image_ids()]
    observations = Counter[int]()
    for image in images:
        observations[image.frame_id] += image.num_points3D
    stated = {reconstruction.image(number).frame_id for number in free.places}
    few = {frame for frame, count in observations.items() if count < FEWEST_OBSERVATIONS} - stated
    return [ViewId.of_image(image.name) for image in images if image.frame_id in few]


def _stated(linear: Linear, reconstruction: Any, free: Free, scale: float) -> tuple[Array, Array]:
    """Derivatives of the parameters by stated places, in units of their weight, [P, K], and that weight
    [K].
    """
    columns, weights = [], []
    for number, place in sorted(free.places.items()):
        image = reconstruction.image(number)
        at = linear.frames.get(image.frame_id)
        if at is None:
            continue
        width = reconstruction.cameras[image.camera_id].width
        weight = variance_of_place(int(image.num_points3D), width, scale)
        turn = image.frame.rig_from_world.rotation.matrix()
        pull = np.zeros((linear.cameras.shape[1], 3 if place.turn is None else 6))
        pull[at + 3 : at + 6, :3] = -turn / place.spread
        if place.turn is not None:
            pull[at : at + 3, 3:] = np.linalg.cholesky(np.linalg.inv(place.turn_covariance()))
        columns.append(np.sqrt(weight) * pull)
        weights += [weight] * pull.shape[1]
    if not columns:
        return np.zeros((linear.cameras.shape[1], 0)), np.zeros(0)
    return np.concatenate(columns, axis=1), np.array(weights)


def _groups(linear: Linear, many: int) -> Integers:
    """Number of the points that share the error of each point."""
    points, first = np.unique(linear.owner, return_index=True)
    side = float(linear.observed[:, 0].max()) / CELLS
    places = np.column_stack([linear.image[first], (linear.observed[first] // side).astype(np.int64)])
    group = np.zeros(many, np.int64)
    group[points] = np.unique(places, axis=0, return_inverse=True)[1].ravel()
    return group


def _poses(reconstruction: Any) -> dict[ViewId, Array]:
    """cam_from_world [4, 4] of every registered view."""
    poses = {}
    for index in sorted(reconstruction.reg_image_ids()):
        image = reconstruction.image(index)
        poses[ViewId.of_image(image.name)] = _square(image.cam_from_world())
    return poses


def _moved(reconstruction: Any, linear: Linear, move: Array) -> dict[ViewId, Array]:
    """The poses after one drawn change."""
    poses = {}
    for index in sorted(reconstruction.reg_image_ids()):
        image = reconstruction.image(index)
        rig = _square(image.frame.rig_from_world)
        mounted = _square(image.cam_from_world()) @ np.linalg.inv(rig)
        at = linear.frames[image.frame_id]
        pose = mounted @ _step(move[at : at + 6]) @ rig
        if image.camera_id in linear.sensors and not is_reference(reconstruction, image):
            at = linear.sensors[image.camera_id]
            pose = _step(move[at : at + 6]) @ pose
        poses[ViewId.of_image(image.name)] = pose
    return poses


def _step(move: Array) -> Array:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = cv2.Rodrigues(move[:3])[0], move[3:]
    return pose


def _square(motion: Any) -> Array:
    return np.vstack([motion.matrix(), [0.0, 0.0, 0.0, 1.0]])


def _aligned(poses: Mapping[ViewId, Array], to: Mapping[ViewId, Array]) -> dict[ViewId, Array]:
    """The poses in the world of others: by all turns first, since centres may lie in a plane or a line."""
    views = list(poses)
    relative = sum((to[view][:3, :3].T @ poses[view][:3, :3] for view in views), np.zeros((3, 3)))
    u, _, vt = np.linalg.svd(relative)
    turn = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt  # new world from old
    old = np.stack([turn @ centre_of(poses[view]) for view in views])
    new = np.stack([centre_of(to[view]) for view in views])
    spread = old - old.mean(0)
    size = float((spread**2).sum())
    scale = float((spread * (new - new.mean(0))).sum()) / size if size > 0 else 1.0
    aligned = {}
    for view, place in zip(views, old, strict=True):
        pose = np.eye(4)
        pose[:3, :3] = poses[view][:3, :3] @ turn.T
        pose[:3, 3] = -pose[:3, :3] @ (scale * (place - old.mean(0)) + new.mean(0))
        aligned[view] = pose
    return aligned


def centre_of(pose: Array) -> Array:
    """Place [3] of a camera with the motion [4, 4] from the world."""
    return np.asarray(-pose[:3, :3].T @ pose[:3, 3])


def _turned(rotation: Array) -> Array:
    """Small rotation as axis times angle, rad."""
    skew = (rotation - rotation.T) / 2
    return np.array([skew[2, 1], skew[0, 2], skew[1, 0]])


def _widest(vectors: list[Array]) -> float:
    """Root mean square along the direction in which it is the largest."""
    stack = np.stack(vectors)
    return float(np.sqrt(np.linalg.eigvalsh(stack.T @ stack / len(stack))[-1].clip(0.0)))

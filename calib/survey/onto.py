"""Alignment of a scene with another session of the same scene, by what both sessions saw.

Both have been calibrated by themselves. Features of their pictures are matched, each pair verified by
its epipolar geometry; scene points of both behind the same features determine the similarity between the two.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import hypot
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import KDTree

from calib.data.features import FEWEST_MATCHES, Features, extract
from calib.data.matching import match
from calib.data.pairs import pairs_to_match
from calib.data.previews import LOCAL_SHARE, blurred
from calib.poses.sfm import SceneModel, transformed
from calib.survey.similarity import Similarity, fit, standard_errors
from imaging.arrays import Array, Integers, Mask
from imaging.colour.spaces import srgb_decode
from imaging.errors import CalibrationError, InputError
from imaging.files.colmap import pycolmap
from imaging.files.photo import read_photo
from imaging.progress import Progress
from imaging.session.calibration import CalibrationRecord, is_stale, read_calibration
from imaging.session.coordinates import CoordinateSystem
from imaging.session.records import Rung
from imaging.session.view_id import ViewId

NAME = "onto"
FEWEST_POINTS = 30
LEAST_SHARE = 0.3
"""Least share of the shared points that have to agree on the alignment."""
NEAR = 1.5
"""px between a feature of a picture and the place where the calibration saw a scene point."""
ROUGH = 0.02
"""Largest residual at first, as a share of the spread of the shared points."""
TOO_FAR = 4.0
"""Medians by which it may miss at last."""
MAX_ERROR = 4.0
"""px of an epipolar geometry."""
_FLOOR = 1 / 255
"""Added to the light of 8-bit pictures before its logarithm: a step of theirs in the dark."""
_MARK = "onto "
"""Prefix of the other session's cameras, whose names may be the same as ours."""


@dataclass(frozen=True, eq=False)
class Target:
    """The session whose coordinates are wanted: its record and its COLMAP model."""

    folder: Path
    record: CalibrationRecord
    reconstruction: Any


def read_target(folder: Path) -> Target:
    """Open a calibrated session; InputError if it is not calibrated, or has no poses, or not those of its
    shots.
    """
    record = read_calibration(folder)
    colmap = folder / "calibration" / "colmap"
    if not record.views or is_stale(folder, record) or not (colmap / "points3D.bin").is_file():
        why = "has no poses" if not record.views else "is not calibrated with all of its shots"
        raise InputError(
            f"{folder} {why}, and nothing can be placed onto it: run `rig calibrate {folder}` first."
        )
    try:
        return Target(folder, record, pycolmap.Reconstruction(str(colmap)))
    except (ValueError, RuntimeError) as error:
        raise InputError(f"{colmap} is damaged: run `rig calibrate {folder}` again.") from error


def place_onto(
    model: SceneModel, features: Mapping[ViewId, Features], target: Target, progress: Progress
) -> tuple[SceneModel, CoordinateSystem]:
    """The model in the coordinates of another session, and how well it stands in them.

    Args:
        model: Scene model, which stays as it is.
        features: Features of the views, as the model was made from them.
        target: Calibrated session whose coordinates are wanted.
        progress: Callback for the current step, the steps done, and all of them.

    Returns:
        The placed model, with a rung; and its coordinates, with their errors.

    Raises:
        CalibrationError: The two share too little; the message is one sentence.
        InputError: A picture of the other session's calibration is missing or damaged.
    """
    ours, theirs, group = _shared_points(model, features, target, progress)
    similarity, fits = _agreeing(ours, theirs)
    share = float(fits.mean()) if len(fits) else 0.0
    if fits.sum() < FEWEST_POINTS or share < LEAST_SHARE:
        agree = f", of which {int(fits.sum())} agree" if len(ours) >= FEWEST_POINTS else ""
        raise CalibrationError(
            f"the pictures share {len(ours)} scene points with those of {target.folder}{agree}, and at "
            f"least {FEWEST_POINTS} are needed: take some of the same parts from nearby positions"
        )
    misses = similarity(ours[fits]) - theirs[fits]
    scatter = np.full(int(fits.sum()), float(np.sqrt((misses**2).mean())))
    _, numbers = np.unique(group[fits], return_inverse=True)
    scale, turn, place = standard_errors(theirs[fits], misses, scatter, numbers)
    metric = target.record.unit == "m"
    located = transformed(model, similarity.sim3d, metric=metric)
    known = target.record.coordinates
    rms = float(np.sqrt((misses**2).sum(1).mean()))
    # The views of both stand in their own models with errors that all shared points have in common.
    turn = hypot(turn, _median(_turns(located)), _median(_turns(target.record)))
    place = hypot(place, _median(_shifts(located)), _median(_shifts(target.record)))
    coordinates = CoordinateSystem(
        source="session",
        system="local" if known is None else known.system,
        offset=(0.0, 0.0, 0.0) if known is None else known.offset,
        origin=None if known is None else known.origin,
        rms=rms, scale_error=scale, rotation_error=turn, position_error=place,
        used=int(fits.sum()), left_out=int((~fits).sum()), onto=str(target.folder.resolve()),
    )  # fmt: skip
    reason = (
        f"{int(fits.sum())} of {len(fits)} scene points that are shared with {target.folder} give scale, "
        f"turn and place in its coordinates; they miss by {rms:.3g} {'m' if metric else 'of its units'} (rms)"
    )
    rung = Rung(name=NAME, taken=True, reason=reason)
    return replace(located, rungs=(*located.rungs, rung)), coordinates


def _turns(placed: SceneModel | CalibrationRecord) -> list[float]:
    """Standard errors of the views' rotations, degrees."""
    if isinstance(placed, SceneModel):
        return [] if placed.errors is None else list(placed.errors.rotation.values())
    return [view.error.rotation for view in placed.views if view.error is not None]


def _shifts(placed: SceneModel | CalibrationRecord) -> list[float]:
    """Standard errors of the views' places, in the unit of the record."""
    if isinstance(placed, SceneModel):
        return [] if placed.errors is None else list(placed.errors.translation.values())
    return [view.error.translation for view in placed.views if view.error is not None]


def _median(values: list[float]) -> float:
    return float(np.median(values)) if values else 0.0


def _shared_points(
    model: SceneModel, features: Mapping[ViewId, Features], target: Target, progress: Progress
) -> tuple[Array, Array, Integers]:
    """Scene points of both that the same features show, [K, 3] and [K, 3], and by which of our views, [K]."""
    ours = {view: rows for view, rows in _shown_points(model.reconstruction).items() if view in features}
    theirs = _shown_points(target.reconstruction)
    looks: dict[ViewId, Features] = {}
    for done, view in enumerate(sorted(theirs)):
        progress(f"reading {target.folder}", done, len(theirs))
        looks[ViewId(view.frame, _MARK + view.camera)] = _features_of(target, view)
    every = {**{view: features[view] for view in ours}, **looks}
    # All views are asked for their neighbours, and only pairs across the two sessions matched.
    pairs = [
        (a, b) if b in looks else (b, a)
        for a, b in pairs_to_match({view: rows.descriptors for view, rows in every.items()}, [])
        if (a in looks) != (b in looks)
    ]
    shared: dict[tuple[int, int], tuple[Array, Array, int]] = {}
    order = {view: number for number, view in enumerate(ours)}
    cameras = _cameras(model.reconstruction), _cameras(target.reconstruction)
    for done, (view, look) in enumerate(pairs):
        progress(f"matching with {target.folder}", done, len(pairs))
        other = ViewId(look.frame, look.camera.removeprefix(_MARK))
        matched = _verified(every[view], every[look], cameras[0][view], cameras[1][other])
        if not len(matched):
            continue
        numbers, places = ours[view].at(every[view].points[matched[:, 0]])
        others, there = theirs[other].at(every[look].points[matched[:, 1]])
        for row in np.flatnonzero((numbers >= 0) & (others >= 0)):
            shared.setdefault((int(numbers[row]), int(others[row])), (places[row], there[row], order[view]))
    progress(f"matching with {target.folder}", len(pairs), len(pairs))
    shared_pairs = list(shared.values())
    return (
        np.array([one for one, _, _ in shared_pairs]).reshape(-1, 3),
        np.array([other for _, other, _ in shared_pairs]).reshape(-1, 3),
        np.array([view for _, _, view in shared_pairs], np.int64),
    )


class _ShownPoints:
    """The scene points that a view of a model shows: where, px [K, 2], their numbers and places [K, 3]."""

    def __init__(self, pixels: Array, numbers: Integers, places: Array) -> None:
        self._tree = KDTree(pixels)
        self._numbers, self._places = numbers, places

    def at(self, pixels: Array) -> tuple[Integers, Array]:
        """Numbers and places of the scene points at these places, px; -1 for none."""
        away, nearest = self._tree.query(pixels)
        near = away < NEAR
        index = np.where(near, nearest, 0)
        return np.where(near, self._numbers[index], -1), self._places[index]


def _shown_points(reconstruction: Any) -> dict[ViewId, _ShownPoints]:
    views = {}
    for index in sorted(reconstruction.reg_image_ids()):
        image = reconstruction.image(index)
        shown = [point for point in image.points2D if point.has_point3D()]
        if shown:
            numbers = np.array([point.point3D_id for point in shown], np.int64)
            views[ViewId.of_image(image.name)] = _ShownPoints(
                np.array([np.ravel(point.xy) for point in shown]),
                numbers,
                np.array([reconstruction.points3D[int(number)].xyz for number in numbers]),
            )
    return views


def _cameras(reconstruction: Any) -> dict[ViewId, Any]:
    return {
        ViewId.of_image(image.name): reconstruction.cameras[image.camera_id]
        for image in (reconstruction.image(index) for index in reconstruction.reg_image_ids())
    }


def _features_of(target: Target, view: ViewId) -> Features:
    """Features of the picture that a calibration keeps of a view, encoded as what it was made from."""
    picture = read_photo(target.folder / "calibration" / "previews" / view.image_name).pixels
    stops = np.log2(srgb_decode(picture.astype(np.float64)).mean(-1) + _FLOOR)
    flat = stops - LOCAL_SHARE * blurred(stops, max(stops.shape[1] / 40, 1.0))
    low, high = (float(value) for value in np.percentile(flat, (0.5, 99.5)))
    return extract(np.asarray(np.clip((flat - low) / max(high - low, 1e-6), 0, 1), np.float32))


def _verified(one: Features, other: Features, camera: Any, other_camera: Any) -> Integers:
    """Matches [M, 2] of two views that fit an epipolar geometry; none where they are too few to mean it."""
    matches = match(one.descriptors, other.descriptors)
    if len(matches) < FEWEST_MATCHES:
        return np.zeros((0, 2), np.int64)
    options = pycolmap.TwoViewGeometryOptions()
    options.ransac.random_seed = 0
    options.ransac.max_error = MAX_ERROR * min(max(camera.width / 1280, 0.5), 1.0)
    options.detect_watermark = False
    geometry = pycolmap.estimate_two_view_geometry(
        camera, one.points, other_camera, other.points, matches, options
    )
    inliers = np.asarray(geometry.inlier_matches, np.int64).reshape(-1, 2)
    return inliers if len(inliers) >= FEWEST_MATCHES else np.zeros((0, 2), np.int64)


def _agreeing(ours: Array, theirs: Array) -> tuple[Similarity, Mask]:
    """The similarity that most points agree about, and which do."""
    nothing = Similarity(1.0, np.eye(3), np.zeros(3)), np.zeros(len(ours), bool)
    if len(ours) < FEWEST_POINTS:
        return nothing
    options = pycolmap.RANSACOptions()
    options.random_seed = 0
    options.max_error = ROUGH * float(np.median(np.linalg.norm(theirs - np.median(theirs, 0), axis=1)))
    rough = pycolmap.estimate_sim3d_robust(ours, theirs, options)
    if rough is None:
        return nothing
    matrix = rough["tgt_from_src"].matrix()
    off = np.linalg.norm(ours @ matrix[:, :3].T + matrix[:, 3] - theirs, axis=1)
    fits = off <= options.max_error
    similarity = nothing[0]
    for _ in range(10):
        if fits.sum() < FEWEST_POINTS:
            return nothing
        similarity = fit(ours[fits], theirs[fits])
        off = np.linalg.norm(similarity(ours) - theirs, axis=1)
        now = off <= min(TOO_FAR * float(np.median(off[fits])), options.max_error)
        if (now == fits).all():
            break
        fits = now
    return similarity, fits

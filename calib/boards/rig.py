"""The bundle adjustment of a rig before a board: corners are known points, a board pose is a frame."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from calib.adjustment.bundle_adjustment import Free, lens_of, opencv_parameters, set_model
from calib.boards.corners import Corners
from calib.boards.first_guess import Start
from calib.poses.rigs.known_rig import camera_of
from imaging.arrays import Array, Integers
from imaging.errors import CalibrationError
from imaging.files.colmap import pycolmap
from imaging.optics.lens import Lens
from imaging.session.records import Board
from imaging.session.view_id import ViewId

CUT = 4.0
"""Corners that miss by more than this many times the median of all are dropped."""
LEAST_CUT = 0.3
"""px; no corner is dropped for less."""
ITERATIONS = 100


@dataclass(frozen=True, eq=False)
class Solved:
    """A rig before a board. misses: px [M], of each corner used, in order of `places` (camera, frame, id)."""

    lenses: dict[str, Lens]
    cam_from_rig: dict[str, Array]
    rig_from_board: dict[int, Array]
    misses: Array
    places: list[tuple[ViewId, int]]

    @property
    def rms(self) -> float:
        """Root mean square of the misses, px."""
        return float(np.sqrt(np.mean(self.misses**2))) if len(self.misses) else 0.0


def solve(
    board: Board,
    corners: Mapping[ViewId, Corners],
    start: Start | Solved,
    free: Free,
    *,
    boards_only: bool = False,
) -> Solved:
    """Adjust lenses, rig and board poses to the corners.

    Least squares, since what was no corner is left out before (`drop_outliers`).

    Args:
        board: Description of the board.
        corners: Corners by view; views of cameras or frames that the start does not place are ignored.
        start: Lenses, rig and board poses to begin with.
        free: Lens model, and whether its principal point is free.
        boards_only: True to adjust the board poses alone.

    Returns:
        The rig, and the miss of each corner that was used.

    Raises:
        CalibrationError: The corners lead to no lens at all.
    """
    model, rows = _model(board, corners, start, free)
    _adjust(model, free, boards_only=boards_only, robust=None)
    return _read(board, model, rows, start)


def drop_outliers(
    board: Board, detected: Mapping[ViewId, Corners], start: Start | Solved, free: Free
) -> tuple[dict[ViewId, Corners], Solved]:
    """Drop the corners that do not fit any placement: adjusts robustly, cuts, and adjusts again, twice.

    Args:
        board: Description of the board.
        detected: Corners by view; views of cameras or frames that the start does not place are left out.
        start: Lenses, rig and board poses to begin with.
        free: Lens model, and whether its principal point is free.

    Returns:
        The corners that are left, of the views that keep four or more; and the rig that fits them.

    Raises:
        CalibrationError: The corners lead to no lens at all.
    """
    inliers = {view: corners for view, corners in detected.items() if _placed(view, start)}
    solved: Start | Solved = start
    for scale in (2.0, 0.3):
        model, rows = _model(board, inliers, solved, free)
        _adjust(model, free, boards_only=False, robust=scale)
        fitted = _read(board, model, rows, solved)
        worst = max(CUT * float(np.median(fitted.misses)), LEAST_CUT)
        good = {place for place, miss in zip(fitted.places, fitted.misses, strict=True) if miss <= worst}
        inliers = {view: _only(corners, view, good) for view, corners in inliers.items()}
        inliers = {view: corners for view, corners in inliers.items() if len(corners.ids) >= 4}
        solved = fitted
    return inliers, solve(board, inliers, solved, free)


def _placed(view: ViewId, start: "Start | Solved") -> bool:
    return view.camera in start.cam_from_rig and view.frame in start.rig_from_board


def _only(corners: Corners, view: ViewId, good: Collection[tuple[ViewId, int]]) -> Corners:
    keep = np.array([(view, corner) in good for corner in corners.ids.tolist()], bool)
    return Corners(corners.ids[keep], corners.points[keep])


Rows = list[tuple[ViewId, int, Integers, Array]]
"""Observations of each image: its view, its number, corner ids and points."""


def _model(
    board: Board, detected: Mapping[ViewId, Corners], start: "Start | Solved", free: Free
) -> tuple[Any, Rows]:
    """A pycolmap reconstruction in the board's coordinates."""
    flat = board.corners()
    detected = _twice({view: corners for view, corners in detected.items() if _placed(view, start)})
    model = pycolmap.Reconstruction()
    names = sorted(start.cam_from_rig)
    number = {name: index + 1 for index, name in enumerate(names)}
    rig = pycolmap.Rig(rig_id=1)
    # COLMAP wants a camera that stands still in the rig: the one nearest to its origin.
    reference = min(names, key=lambda name: float(np.abs(start.cam_from_rig[name] - np.eye(4)).max()))
    for name in [reference, *(name for name in names if name != reference)]:
        camera = camera_of(start.lenses[name])
        camera.camera_id = number[name]
        set_model(camera, free.model)
        model.add_camera(camera)
        sensor = pycolmap.sensor_t(pycolmap.SensorType.CAMERA, number[name])
        if name == reference:
            rig.add_ref_sensor(sensor)
        else:
            rig.add_sensor(sensor, pycolmap.Rigid3d(start.cam_from_rig[name][:3]))
    model.add_rig(rig)
    views = sorted(detected)
    rows: Rows = []
    image_of = {view: index + 1 for index, view in enumerate(views)}
    for place, frame in enumerate(sorted({view.frame for view in views}), start=1):
        one = pycolmap.Frame(frame_id=place, rig_id=1)
        one.rig_from_world = pycolmap.Rigid3d(start.rig_from_board[frame][:3])
        for view in (view for view in views if view.frame == frame):
            sensor = pycolmap.sensor_t(pycolmap.SensorType.CAMERA, number[view.camera])
            one.add_data_id(pycolmap.data_t(sensor, image_of[view]))
        model.add_frame(one)
        for view in (view for view in views if view.frame == frame):
            corners = detected[view]
            # All corners at once: one by one they would take as long as the adjustment.
            image = pycolmap.Image(
                view.image_name,
                np.asarray(corners.points, np.float64),
                number[view.camera],
                image_of[view],
            )
            image.frame_id = place
            model.add_image(image)
            rows.append((view, image_of[view], corners.ids, corners.points))
        model.register_frame(place)
    # Every corner of the board is a point of the scene, whose place in it is known.
    tracks: dict[int, list[Any]] = {}
    for _, index, ids, _ in rows:
        for place, corner in enumerate(ids.tolist()):
            tracks.setdefault(corner, []).append(pycolmap.TrackElement(index, place))
    for corner, elements in sorted(tracks.items()):
        track = pycolmap.Track()
        track.add_elements(elements)
        model.add_point3D(flat[corner], track)
    return model, rows


def _twice(detected: Mapping[ViewId, Corners]) -> dict[ViewId, Corners]:
    """The corners without those that only one view shows: pycolmap takes no point that is seen once."""
    ids, counts = np.unique(
        np.concatenate([corners.ids for corners in detected.values()]), return_counts=True
    )
    often = ids[counts > 1]
    shared = {}
    for view, corners in detected.items():
        keep = np.isin(corners.ids, often)
        shared[view] = Corners(corners.ids[keep], corners.points[keep])
    return shared


def _adjust(model: Any, free: Free, *, boards_only: bool, robust: float | None) -> None:
    options = pycolmap.BundleAdjustmentOptions()
    options.print_summary = False
    options.refine_focal_length = options.refine_extra_params = not boards_only
    options.refine_principal_point = free.principal_point and not boards_only
    options.refine_sensor_from_rig = not boards_only
    options.refine_rig_from_world = True
    if robust is not None:
        options.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
        options.ceres.loss_function_scale = robust
    solver = options.ceres.solver_options
    solver.num_threads = 1  # threads add up in the order in which they finish
    solver.max_num_iterations = ITERATIONS
    # Where tangential terms and the principal point trade places, the last digits of the cost decide.
    solver.function_tolerance = 1e-12
    solver.gradient_tolerance = solver.parameter_tolerance = 1e-12
    config = pycolmap.BundleAdjustmentConfig()
    for image in sorted(model.reg_image_ids()):
        config.add_image(image)
    for point in sorted(model.points3D):
        config.add_constant_point(point)
    pycolmap.create_default_bundle_adjuster(options, config, model).solve()


def _read(board: Board, model: Any, rows: Rows, start: "Start | Solved") -> Solved:
    flat, rig = board.corners(), model.rigs[1]
    names = sorted(start.cam_from_rig)
    lenses, mounted = dict(start.lenses), {}
    for index, name in enumerate(names, start=1):
        camera = model.cameras[index]
        if not np.isfinite(camera.params).all() or min(opencv_parameters(camera)[:2]) <= 0:
            raise CalibrationError(
                f"The corners of the board fit no lens of {name}: show the board larger, tilted, and in more "
                "frames."
            )
        lenses[name] = lens_of(camera)
        sensor = pycolmap.sensor_t(pycolmap.SensorType.CAMERA, index)
        mounted[name] = np.eye(4) if rig.is_ref_sensor(sensor) else _square(rig.sensor_from_rig(sensor))
    boards, misses, places = dict(start.rig_from_board), [], []
    for view, index, ids, points in rows:
        image = model.images[index]
        boards[view.frame] = _square(image.frame.rig_from_world)
        motion = image.cam_from_world().matrix()
        local = flat[ids] @ motion[:, :3].T + motion[:, 3]
        ahead = local[:, 2] > 1e-9
        projected = np.full(points.shape, np.inf)
        if ahead.any():
            projected[ahead] = model.cameras[image.camera_id].img_from_cam(local[ahead])
        misses.append(np.nan_to_num(np.linalg.norm(projected - points, axis=1), nan=np.inf, posinf=np.inf))
        places += [(view, corner) for corner in ids.tolist()]
    return Solved(lenses, mounted, boards, np.concatenate(misses) if misses else np.zeros(0), places)


def _square(motion: Any) -> Array:
    pose = np.eye(4)
    pose[:3] = motion.matrix()
    return pose

"""Structure from motion: poses, lenses and scene points from features, with the rig as a constraint."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from calib.features import Features, Key, Pair, Progress, fill_database
from imaging.calibration import Lens, Pose
from imaging.colmap import pycolmap
from imaging.errors import CalibrationError

MAX_ERROR = 4.0
"""Of a correspondence, px, in pictures of 1280 px or wider; less in smaller ones, at least half of it."""
FEWEST_FEATURES = 40
"""A view with fewer cannot be placed."""
ROTATION_SHARE = 0.85
"""Of the inliers of a pair that one homography explains, above which there is no baseline to see."""
ROUNDS = 3
"""Of cutting outliers and adjusting again."""


@dataclass(frozen=True, eq=False)
class Model:
    """What structure from motion found; lenses and errors in pixels of the pictures.

    reconstruction: the pycolmap model. poses: cam_from_world of every registered view. cam_from_rig: of
    every camera, if the rig constraint held. points: scene points that each view sees.
    """

    reconstruction: Any
    lenses: dict[str, Lens]
    poses: dict[Key, Pose]
    cam_from_rig: dict[str, Pose]
    points: dict[Key, int]
    reprojection_px: float
    rigged: bool


def solve(
    features: Mapping[Key, Features],
    cameras: Mapping[str, Lens],
    rigs: Sequence[Sequence[str]],
    threads: int,
    progress: Progress,
    *,
    focal_known: bool = False,
) -> Model:
    """Place the views. Errors: CalibrationError that names the cause when none can be placed.

    features: of every view, in picture pixels. cameras: a first guess of each lens, at picture size.
    rigs: names of cameras that are rigidly mounted to each other. focal_known: the guesses come from a
    file's focal length rather than from nothing.
    """
    _refuse_hopeless(features)
    width = max(lens.width for lens in cameras.values())
    max_error = MAX_ERROR * min(max(width / 1280, 0.5), 1.0)
    database = pycolmap.Database.open(":memory:")
    models = {name: _camera(lens, focal_known) for name, lens in cameras.items()}
    pairs = fill_database(database, models, features, max_error, progress)
    if not pairs:
        raise CalibrationError(
            "No two views share enough of the scene to be placed: take views that overlap by two thirds."
        )
    reconstruction = _map(database, len(features), max_error, threads, progress)
    if reconstruction is None:
        raise CalibrationError(_why_no_model(pairs))
    rigged = _rig(database, reconstruction, rigs)
    progress("adjusting", 0, ROUNDS + 1)
    _adjust(reconstruction, 0.25 * max_error / 2, threads)
    for turn in range(ROUNDS):
        progress("adjusting", turn + 1, ROUNDS + 1)
        # The scale of the robust loss follows the data: sub-pixel corners deserve more than a fixed pixel.
        typical = _cut(reconstruction, least=0.15 * max_error)
        _adjust(reconstruction, typical, threads)
    progress("adjusting", ROUNDS + 1, ROUNDS + 1)
    return _model(reconstruction, cameras, rigged)


def _refuse_hopeless(features: Mapping[Key, Features]) -> None:
    if len(features) < 2:
        raise CalibrationError(
            "One view alone has no pose: take more views of the same scene from other places."
        )
    blank = [name for name, own in features.items() if len(own.points) < FEWEST_FEATURES]
    if len(features) - len(blank) < 2:
        raise CalibrationError(
            f"{len(blank)} of {len(features)} views show no texture to hold on to (black, saturated, "
            "blurred or blank): expose for the scene or add texture to it."
        )


def _camera(lens: Lens, focal_known: bool) -> Any:
    camera = pycolmap.Camera.create_from_model_name(0, "SIMPLE_RADIAL", lens.fx, lens.width, lens.height)
    camera.has_prior_focal_length = focal_known
    return camera


def _map(database: Any, views: int, max_error: float, threads: int, progress: Progress) -> Any | None:
    options = pycolmap.IncrementalPipelineOptions()
    options.min_model_size = 2
    options.random_seed = 0
    options.num_threads = threads
    options.extract_colors = False
    options.ba_refine_principal_point = False
    options.mapper.init_min_tri_angle = 8
    options.mapper.filter_max_reproj_error = max_error
    options.triangulation.merge_max_reproj_error = max_error
    options.triangulation.complete_max_reproj_error = max_error
    options.triangulation.ignore_two_view_tracks = views >= 4
    found = pycolmap.ReconstructionManager()
    pipeline = pycolmap.IncrementalPipeline(options, database, found)
    placed = 0

    def begun() -> None:
        nonlocal placed
        placed = 2
        progress("placing views", min(placed, views), views)

    def another() -> None:
        nonlocal placed
        placed += 1
        progress("placing views", min(placed, views), views)

    progress("placing views", 0, views)
    pipeline.add_callback(0, begun)  # the first pair of a model is placed
    pipeline.add_callback(1, another)  # one more image is placed
    pipeline.run()
    models = [found.get(index) for index in range(found.size())]
    return max(models, key=lambda model: model.num_reg_images(), default=None)


def _why_no_model(pairs: Mapping[tuple[Key, Key], Pair]) -> str:
    planar = float(np.median([pair.planar for pair in pairs.values()]))
    if planar > ROTATION_SHARE:
        return (
            f"The views match but show no depth (one homography explains {100 * planar:.0f} % of the "
            "matches): move the camera sideways between views instead of turning it on the spot."
        )
    return (
        f"Only {len(pairs)} pairs of views match and no two of them give a stable start: take more views, "
        "at most 30 degrees apart, that overlap by two thirds."
    )


def _rig(database: Any, reconstruction: Any, rigs: Sequence[Sequence[str]]) -> bool:
    """Tie the cameras of each rig together, where a frame shows each with the rig's reference camera."""
    registered: dict[str, set[str]] = {}
    for index in reconstruction.reg_image_ids():
        camera, frame = reconstruction.image(index).name.split("/")
        registered.setdefault(camera, set()).add(frame)
    configs = []
    for names in rigs:
        frames = [registered.get(name, set()) for name in names]
        if len(names) < 2 or not all(len(own & frames[0]) >= 2 for own in frames):
            continue
        config = pycolmap.RigConfig()
        members = []
        for name in names:
            member = pycolmap.RigConfigCamera()
            member.image_prefix = f"{name}/"
            member.ref_sensor = name == names[0]
            members.append(member)
        config.cameras = members
        configs.append(config)
    if configs:
        pycolmap.apply_rig_config(configs, database, reconstruction)
    return bool(configs)


def _adjust(reconstruction: Any, scale: float, threads: int) -> None:
    """Bundle adjustment with a Cauchy loss of `scale` px. The principal point stays in the middle:
    on an arc it cannot be told from a turn of the camera."""
    options = pycolmap.BundleAdjustmentOptions()
    options.print_summary = False
    options.refine_principal_point = False
    options.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
    options.ceres.loss_function_scale = scale
    solver = options.ceres.solver_options
    solver.num_threads = threads
    solver.max_num_iterations = 50
    solver.function_tolerance = 1e-6
    config = pycolmap.BundleAdjustmentConfig()
    for image in reconstruction.reg_image_ids():
        config.add_image(image)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    pycolmap.create_default_bundle_adjuster(options, config, reconstruction).solve()


def _cut(reconstruction: Any, least: float) -> float:
    """Drop observations that miss by more than four times the median; returns the median, px."""
    where, miss = [], []
    for key, point in reconstruction.points3D.items():
        for element in point.track.elements:
            image = reconstruction.image(element.image_id)
            seen = image.project_point(point.xyz)
            own = np.ravel(image.point2D(element.point2D_idx).xy)
            where.append((key, element.image_id, element.point2D_idx))
            miss.append(np.inf if seen is None else float(np.linalg.norm(np.ravel(seen) - own)))
    typical = float(np.median(miss))
    for (_, image_id, index), error in zip(where, miss, strict=True):
        far = error > max(4 * typical, least)
        if far and reconstruction.image(image_id).point2D(index).has_point3D():
            reconstruction.delete_observation(image_id, index)
    return max(typical, 0.02)


def _model(reconstruction: Any, cameras: Mapping[str, Lens], rigged: bool) -> Model:
    poses: dict[Key, Pose] = {}
    points: dict[Key, int] = {}
    lenses: dict[str, Lens] = {}
    mounted: dict[str, Pose] = {}
    for index in sorted(reconstruction.reg_image_ids()):
        image = reconstruction.image(index)
        name, file = image.name.split("/")
        key = (name, int(file.removesuffix(".png")))
        poses[key] = _pose(image.cam_from_world())
        points[key] = int(image.num_points3D)
        lenses[name] = _lens(reconstruction.cameras[image.camera_id], cameras[name])
        if rigged:
            rig = reconstruction.rigs[image.frame.rig_id]
            sensor = pycolmap.sensor_t(pycolmap.SensorType.CAMERA, image.camera_id)
            if rig.is_ref_sensor(sensor):
                mounted[name] = Pose(quaternion=(1, 0, 0, 0), translation=(0, 0, 0))
            else:
                mounted[name] = _pose(rig.sensor_from_rig(sensor))
    reconstruction.update_point_3d_errors()
    return Model(
        reconstruction, lenses, poses, mounted, points,
        float(reconstruction.compute_mean_reprojection_error()), rigged,
    )  # fmt: skip


def _pose(motion: Any) -> Pose:
    x, y, z, w = (float(value) for value in motion.rotation.quat)
    a, b, c = (float(value) for value in motion.translation)
    return Pose(quaternion=(w, x, y, z), translation=(a, b, c))


def _lens(camera: Any, guess: Lens) -> Lens:
    focal, cx, cy, k1 = (float(value) for value in camera.params)
    return guess.model_copy(
        update={"model": "SIMPLE_RADIAL", "fx": focal, "fy": focal, "cx": cx, "cy": cy, "k1": k1}
    )


def centres(poses: Sequence[Pose]) -> npt.NDArray[np.float64]:
    """Camera centres [N, 3] of cam_from_world poses."""
    matrices = np.stack([pose.matrix() for pose in poses])
    return np.asarray(-np.einsum("nji,nj->ni", matrices[:, :3, :3], matrices[:, :3, 3]))

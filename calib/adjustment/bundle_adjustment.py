"""Bundle adjustment that corner points of a fraction of a pixel deserve: robust, and rid of outliers."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np

from calib.adjustment.fisheye import nearest_terms
from calib.adjustment.focal_priors import FocalPrior, add_focal_priors
from calib.adjustment.observations import observations
from calib.adjustment.place_priors import StatedPlace, add_place_priors
from imaging.arrays import Array, Integers
from imaging.files.colmap import pycolmap
from imaging.optics.lens import Lens, LensModel

CUT = 4.0
"""Observations that miss by more than this many times the median are dropped."""
LOSS = 2.0
"""Scale of the Cauchy loss, in median residuals: these are some 0.8 standard deviations of the noise, part of
which a fit follows. With a scale of one, two or three, camera centres of a telephone's video are 0.093, 0.061
and 0.040 % of the extent off in the median; with three, a few views beside a black one come to stand 2.8
degrees off, for less than one degree."""
MOST_ITERATIONS = 50
STILL = 1e-6
"""Share of the loss that a step has to gain for another to follow."""
ROUGH_ITERATIONS, ROUGHLY_STILL = 15, 1e-4
"""Iterations and threshold of a rough adjustment, which only has to identify outliers: with more steps poses
were no better.
"""


@dataclass(frozen=True)
class Free:
    """Free terms of the lenses, beside the focal length.

    radial: whether a SIMPLE_RADIAL has its one term; else it is zero. fixed: cameras, by COLMAP's number,
    whose lens stays as it is. placed: those whose place in the rig stays. focal: priors of focal lengths, by
    COLMAP's number. places: priors of images' places, by theirs.
    """

    model: LensModel = "SIMPLE_RADIAL"
    radial: bool = True
    principal_point: bool = False
    fixed: frozenset[int] = frozenset()
    placed: frozenset[int] = frozenset()
    focal: Mapping[int, FocalPrior] = field(default_factory=dict)
    places: Mapping[int, StatedPlace] = field(default_factory=dict)

    def within(self, reconstruction: Any) -> Self:
        """The same without the priors of cameras that a model lacks, since none of their views is placed."""
        cameras = reconstruction.cameras
        return replace(self, focal={number: one for number, one in self.focal.items() if number in cameras})


def adjust(
    reconstruction: Any,
    free: Free,
    scale: float,
    threads: int,
    *,
    points_only: bool = False,
    rough: bool = False,
) -> None:
    """Adjust points, poses and lenses in place, with a Cauchy loss.

    Args:
        reconstruction: pycolmap's; its cameras that are not fixed get the lens model of `free`.
        free: Free terms of the lenses, parts that stay, and priors.
        scale: Typical miss of an observation, px; the scale of the loss is `LOSS` times it.
        threads: Number of threads of the solver.
        points_only: True to adjust the points alone; poses and lenses stay, and no priors count.
        rough: True for fewer steps, which are enough to identify outliers.
    """
    for number, camera in reconstruction.cameras.items():
        if number not in free.fixed:
            set_model(camera, free.model)
            if not free.radial:
                camera.params = [*camera.params[:3], 0.0]
    options = pycolmap.BundleAdjustmentOptions()
    options.print_summary = False
    options.refine_focal_length = not points_only
    options.refine_extra_params = free.radial and not points_only
    options.refine_principal_point = free.principal_point and not points_only
    options.refine_rig_from_world = options.refine_sensor_from_rig = not points_only
    options.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
    options.ceres.loss_function_scale = LOSS * scale
    solver = options.ceres.solver_options
    solver.num_threads = threads
    solver.max_num_iterations = ROUGH_ITERATIONS if rough else MOST_ITERATIONS
    solver.function_tolerance = ROUGHLY_STILL if rough else STILL
    config = pycolmap.BundleAdjustmentConfig()
    for image in sorted(reconstruction.reg_image_ids()):
        config.add_image(image)
    for number in sorted(free.fixed):
        config.set_constant_cam_intrinsics(number)
    for sensor in _tied(reconstruction, free.placed):
        config.set_constant_sensor_from_rig_pose(sensor)
    # Nothing fixes where the world begins, or its scale: the solver's damping keeps them where they are. Two
    # cameras held in place, as is usual, are too near to each other where a view was taken twice.
    # The class, and not `bundle_adjustment`, which prints whatever its options say.
    adjuster = pycolmap.create_default_ceres_bundle_adjuster(options, config, reconstruction)
    priors = {number: one for number, one in free.focal.items() if number not in free.fixed}
    added: list[Any] = []
    if not points_only:
        added += add_focal_priors(adjuster.problem, reconstruction, priors, scale)
        added += add_place_priors(adjuster.problem, reconstruction, free.places, scale)
    adjuster.solve()
    added.clear()


def _tied(reconstruction: Any, placed: frozenset[int]) -> list[Any]:
    """The sensors of rigs of several cameras whose place in the rig stays."""
    return [
        sensor
        for number in sorted(reconstruction.rigs)
        for sensor in sorted(reconstruction.rigs[number].non_ref_sensors, key=lambda sensor: sensor.id)
        if sensor.id in placed
    ]


def set_model(camera: Any, model: LensModel) -> None:
    """Give a pycolmap camera a model with more terms, or fewer, keeping what both have.

    What becomes a fisheye begins as the one that is nearest to its radial terms.
    """
    if camera.model_name == model:
        return
    fx, fy, cx, cy, *terms = opencv_parameters(camera)
    k1, k2, p1, p2 = (0.0,) * 4 if is_fisheye(camera) else terms
    corner = float(np.hypot(max(cx, camera.width - cx) / fx, max(cy, camera.height - cy) / fy))
    angular = terms if is_fisheye(camera) else nearest_terms(k1, k2, corner)
    parameters = {
        "PINHOLE": [fx, fy, cx, cy],
        "SIMPLE_RADIAL": [(fx + fy) / 2, cx, cy, k1],
        "RADIAL": [(fx + fy) / 2, cx, cy, k1, k2],
        "OPENCV": [fx, fy, cx, cy, k1, k2, p1, p2],
        "RADIAL_FISHEYE": [(fx + fy) / 2, cx, cy, *angular[:2]],
        "OPENCV_FISHEYE": [fx, fy, cx, cy, *angular],
    }[model]
    camera.model = getattr(pycolmap.CameraModelId, model)
    camera.params = parameters


def is_fisheye(camera: Any) -> bool:
    """Return whether a pycolmap camera's terms are those of the angle from the axis."""
    return camera.model_name in ("RADIAL_FISHEYE", "OPENCV_FISHEYE")


def opencv_parameters(camera: Any) -> list[float]:
    """The eight `Lens.terms` of a pycolmap camera of one of our models."""
    parameters = [float(value) for value in camera.params]
    if camera.model_name in ("OPENCV", "OPENCV_FISHEYE", "PINHOLE"):
        return [*parameters, 0.0, 0.0, 0.0, 0.0][:8]
    focal, cx, cy, *radial = parameters
    return [focal, focal, cx, cy, *radial, 0.0, 0.0, 0.0][:8]


def lens_of(camera: Any) -> Lens:
    """The lens of a pycolmap camera of one of our models."""
    fx, fy, cx, cy, *terms = opencv_parameters(camera)
    lens = Lens(model=camera.model_name, width=camera.width, height=camera.height, fx=fx, fy=fy, cx=cx, cy=cy)
    return lens.model_copy(update=dict(zip(lens.names[4:], terms, strict=True)))


@dataclass(frozen=True, eq=False)
class Misses:
    """Distance of each observation from its point's projection, px; inf where it is behind the camera."""

    image: Integers
    feature: Integers
    error: Array

    @property
    def typical(self) -> float:
        """The median, at least a fiftieth of a pixel."""
        return max(float(np.median(self.error)), 0.02) if len(self.error) else 0.02


def misses(reconstruction: Any) -> Misses:
    """Compute the residuals of all observations, in order of images and features."""
    table = observations(reconstruction)
    error = np.full(len(table.image), np.inf)
    for index, rows in table.of_images():
        image = reconstruction.image(index)
        motion = image.cam_from_world().matrix()
        camera = table.world[table.point[rows]] @ motion[:, :3].T + motion[:, 3]
        front = np.flatnonzero(camera[:, 2] > 1e-9)
        if len(front):
            projected = reconstruction.cameras[image.camera_id].img_from_cam(camera[front])
            miss = np.linalg.norm(projected - table.observed[rows][front], axis=1)
            error[rows.start + front] = np.where(np.isfinite(miss), miss, np.inf)
    return Misses(table.image, table.feature, error)


def drop_outliers(reconstruction: Any, least: float) -> float:
    """Drop observations that miss by CUT times the median, and by `least` px; returns the median."""
    residuals = misses(reconstruction)
    far = residuals.error > max(CUT * residuals.typical, least)
    for image, feature in zip(residuals.image[far].tolist(), residuals.feature[far].tolist(), strict=True):
        # Dropping the last but one observation of a point has dropped the point, and the other with it.
        if reconstruction.image(image).point2D(feature).has_point3D():
            reconstruction.delete_observation(image, feature)
    return residuals.typical

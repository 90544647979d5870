"""Structure from motion: poses, lenses and scene points from features, with the rig as a constraint."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from calib.adjustment.bundle_adjustment import Free, lens_of
from calib.adjustment.drawn_lenses import weak_terms
from calib.adjustment.uncertainty import StandardErrors, standard_errors
from calib.poses.adjusted import adjusted_model
from calib.poses.checks.confirmation import hanging, loose
from calib.poses.pose_inputs import PoseInputs
from calib.poses.refusals import require_features
from calib.poses.rigs.known_rig import to_metres
from calib.poses.turning.turned_views import TurnedViews
from imaging.arrays import Array
from imaging.files.colmap import pycolmap
from imaging.optics.lens import Lens
from imaging.optics.pose import Pose
from imaging.session.records import Rung
from imaging.session.view_id import ViewId

_LENS_KINDS = ("lens_radial_1", "lens_radial_2", "lens_tangential", "lens_fisheye")
"""Rungs that a fisheye has behind it."""


@dataclass(frozen=True, eq=False)
class SceneModel:
    """Result of structure from motion; lenses and errors in pixels of the pictures.

    reconstruction: the pycolmap model. poses: cam_from_world of every registered view. cam_from_rig: of
    every camera, if the rig constraint held. points: scene points that each view sees. rungs: the
    ladder of rig and lens. contradicted: views that were left out because others said that their poses were
    false. hanging: views that one pair holds on the others. free: how it was adjusted.
    by_motion: cameras that nothing but their motion ties to the others.
    """

    reconstruction: Any
    lenses: dict[str, Lens]
    poses: dict[ViewId, Pose]
    cam_from_rig: dict[str, Pose]
    points: dict[ViewId, int]
    reprojection_px: float
    rungs: tuple[Rung, ...]
    errors: StandardErrors | None
    metric: bool
    contradicted: frozenset[ViewId] = frozenset()
    hanging: frozenset[ViewId] = frozenset()
    free: Free | None = None
    by_motion: frozenset[str] = frozenset()

    @property
    def focal_held(self) -> frozenset[str]:
        """Cameras whose focal length the scene does not determine, so that it was held."""
        held = set() if self.free is None else {key for key, one in self.free.focal.items() if one.held}
        images = self.reconstruction.images.values()
        return frozenset(ViewId.of_image(one.name).camera for one in images if one.camera_id in held)


def solve(inputs: PoseInputs, cameras: Mapping[str, Lens]) -> SceneModel:
    """Place the views, tie rigs together, and choose the terms of the lenses.

    Args:
        inputs: Features and all that is known of the cameras.
        cameras: First guess of each lens, at picture size.

    Returns:
        The model, with its rungs and standard errors.

    Raises:
        CalibrationError: No view can be placed; the message names the cause.
    """
    require_features(inputs.features, inputs.blank)
    adjusted = adjusted_model(inputs, cameras)
    if isinstance(adjusted, TurnedViews):
        return _turned(adjusted)
    rungs: tuple[Rung, ...] = ()
    if adjusted.is_fisheye and not any(lens.fisheye for lens in cameras.values()):
        # What no radial terms brought near to its place was dropped meanwhile, at the corners most of all.
        rungs = tuple(rung for rung in adjusted.lens_rungs if rung.name in _LENS_KINDS)
        again = adjusted_model(inputs, {**cameras, **adjusted.centred(cameras)})
        if isinstance(again, TurnedViews):
            return _turned(again)
        adjusted = again
    if adjusted.metric and not adjusted.free.placed:  # distances are better known now than at first
        for rig in inputs.rigs:
            to_metres(
                adjusted.reconstruction,
                inputs.known,
                [name for name in rig if name not in adjusted.by_motion],
            )
    # Errors of lenses that were held are those of their files, which are not known.
    errors = standard_errors(
        adjusted.reconstruction,
        adjusted.free,
        adjusted.typical,
        inputs.progress,
        weak_terms(adjusted.lens_rungs),
    )
    if errors is not None:
        errors = errors.without_lenses(adjusted.held)
    doubts = [
        doubt
        for doubt in (
            hanging(adjusted.hanging, inputs.names),
            loose({} if errors is None else _turn_errors(adjusted.reconstruction, errors), inputs.names),
        )
        if doubt is not None
    ]
    rungs = (*rungs, *adjusted.rungs, adjusted.rig_rung, *adjusted.lens_rungs, *doubts)
    return SceneModel(
        adjusted.reconstruction,
        **fields_of(adjusted.reconstruction),
        rungs=rungs,
        errors=errors,
        metric=adjusted.metric,
        contradicted=adjusted.left_out,
        hanging=adjusted.hanging,
        free=adjusted.free,
        by_motion=adjusted.by_motion,
    )


def _turned(views: TurnedViews) -> SceneModel:
    """The model of views from one place, whose errors are not stated."""
    fields = fields_of(views.reconstruction)
    return SceneModel(
        views.reconstruction,
        **fields,
        rungs=(views.rung,),
        errors=None,
        metric=False,
    )


def _turn_errors(reconstruction: Any, errors: StandardErrors) -> dict[ViewId, float]:
    """Standard error of each registered view's turn, degrees; infinite where none can be stated."""
    names = (reconstruction.image(number).name for number in reconstruction.reg_image_ids())
    return {view: errors.rotation.get(view, float("inf")) for view in map(ViewId.of_image, names)}


def transformed(model: SceneModel, transform: Any, *, metric: bool = True) -> SceneModel:
    """The model in other coordinates by a pycolmap.Sim3d; its reconstruction is changed in place.

    metric: whether these are metres.
    """
    model.reconstruction.transform(transform)
    errors = model.errors and replace(
        model.errors,
        translation={view: transform.scale * one for view, one in model.errors.translation.items()},
        mounted={
            name: (turn, transform.scale * shift) for name, (turn, shift) in model.errors.mounted.items()
        },
    )
    return replace(model, **fields_of(model.reconstruction), errors=errors, metric=metric)


def fields_of(reconstruction: Any) -> dict[str, Any]:
    """Fields of `SceneModel` that a reconstruction determines."""
    poses: dict[ViewId, Pose] = {}
    points: dict[ViewId, int] = {}
    lenses: dict[str, Lens] = {}
    mounted: dict[str, Pose] = {}
    for index in sorted(reconstruction.reg_image_ids()):
        image = reconstruction.image(index)
        view = ViewId.of_image(image.name)
        name = view.camera
        poses[view] = pose_of(image.cam_from_world())
        points[view] = int(image.num_points3D)
        lenses[name] = lens_of(reconstruction.cameras[image.camera_id])
        rig = reconstruction.rigs[image.frame.rig_id]
        sensor = pycolmap.sensor_t(pycolmap.SensorType.CAMERA, image.camera_id)
        if rig.num_sensors() > 1:
            still = Pose(quaternion=(1, 0, 0, 0), translation=(0, 0, 0))
            mounted[name] = still if rig.is_ref_sensor(sensor) else pose_of(rig.sensor_from_rig(sensor))
    reconstruction.update_point_3d_errors()
    return {
        "lenses": lenses,
        "poses": poses,
        "cam_from_rig": mounted,
        "points": points,
        "reprojection_px": float(reconstruction.compute_mean_reprojection_error()),
    }


def pose_of(motion: Any) -> Pose:
    """A pycolmap.Rigid3d as a Pose."""
    x, y, z, w = (float(value) for value in motion.rotation.quat)
    a, b, c = (float(value) for value in motion.translation)
    return Pose(quaternion=(w, x, y, z), translation=(a, b, c))


def centres(poses: Sequence[Pose]) -> Array:
    """Camera centres [N, 3] of cam_from_world poses."""
    matrices = np.stack([pose.matrix() for pose in poses])
    return np.asarray(-np.einsum("nji,nj->ni", matrices[:, :3, :3], matrices[:, :3, 3]))

"""Structure from motion: poses, lenses and scene points from features, with the rig as a constraint."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from calib.adjustment.bundle_adjustment import Free, adjust, lens_of, misses
from calib.adjustment.lens_ladder import climb
from calib.adjustment.place_priors import StatedPlace
from calib.adjustment.point_refinement import refine_points
from calib.adjustment.uncertainty import StandardErrors, standard_errors
from calib.data.features import FEWEST_MATCHES, Features
from calib.data.unfinished import Unfinished
from calib.poses.checks.confirmation import hanging, loose
from calib.poses.first_model import NO_START, Scene, camera_numbers, first_models, matched
from calib.poses.focal import focal_priors, settle_focal
from calib.poses.places import align_to_places
from calib.poses.refusals import require_features
from calib.poses.rigs.apart import Joined, join, unjoined
from calib.poses.rigs.known_rig import NOTHING, KnownRig, camera_of, to_metres
from calib.poses.rigs.tied_model import polish, tied_model
from calib.poses.turning.turned_views import TurnedViews, turned_views
from calib.sensor.focal_length import FocalLength
from imaging.arrays import Array
from imaging.errors import CalibrationError
from imaging.files.colmap import pycolmap
from imaging.lens import Lens
from imaging.pose import Pose
from imaging.progress import Progress
from imaging.session.records import Rung
from imaging.session.view_id import ViewId

MAX_ERROR = 4.0
"""Largest error of a correspondence, px, in pictures of 1280 px or wider; less in smaller ones, at least half
of it.
"""
ALIGNED = 0.4
"""Patches err by less than features, of whose error this is a part."""
_LENS_KINDS = ("lens_radial_1", "lens_radial_2", "lens_tangential", "lens_fisheye")
"""Rungs that a fisheye has behind it."""


@dataclass(frozen=True, eq=False)
class SceneModel:
    """Result of structure from motion; lenses and errors in pixels of the pictures.

    reconstruction: the pycolmap model. poses: cam_from_world of every registered view. cam_from_rig: of
    every camera, if the rig constraint held. points: scene points that each view sees. rungs: the
    ladder of rig and lens. contradicted: views that were left out because others said that their poses were
    false. hanging: views that one pair holds on the others. free: how it was adjusted; typical: its miss, px.
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
    typical: float = 0.0
    by_motion: frozenset[str] = frozenset()

    @property
    def focal_held(self) -> frozenset[str]:
        """Cameras whose focal length the scene does not determine, so that it was held."""
        held = set() if self.free is None else {key for key, one in self.free.focal.items() if one.held}
        images = self.reconstruction.images.values()
        return frozenset(ViewId.of_image(one.name).camera for one in images if one.camera_id in held)

    @property
    def rigged(self) -> bool:
        """True if cameras are tied to each other."""
        return any(rung.name == "rig_constraint" and rung.taken for rung in self.rungs)


def solve(
    features: Mapping[ViewId, Features],
    cameras: Mapping[str, Lens],
    rigs: Sequence[Sequence[str]],
    threads: int,
    progress: Progress,
    *,
    focal_known: Collection[str] = (),
    focal: Mapping[str, FocalLength] | None = None,
    stated: Mapping[ViewId, StatedPlace] | None = None,
    known: KnownRig = NOTHING,
    blank: Mapping[ViewId, str] | None = None,
    pictures: Mapping[ViewId, bytes] | None = None,
    brightness: Mapping[ViewId, Array] | None = None,
    exact: Collection[str] = (),
    steady: Collection[str] = (),
    unfinished: Unfinished | None = None,
    keep_doubtful: bool = False,
    names: Mapping[ViewId, str] | None = None,
) -> SceneModel:
    """Place the views. Errors: CalibrationError that names the cause when none can be placed.

    features: of every view, in picture pixels. cameras: a first guess of each lens, at picture size. rigs:
    names of cameras that are rigidly mounted to each other. focal_known: cameras whose guess comes from a
    file's focal length rather than from nothing. focal: prior from the files, at picture size, of the weight
    that its spread has against the scene. known: lenses at picture size and rig poses from a board, which
    stay; the model is in metres where that placed two cameras of a rig. blank: reasons why views show
    nothing. pictures: of views with little noise, as grey PNGs, for places more exact than those of features.
    exact: cameras whose brightness differs only where things do. steady: those whose exposure stays the same,
    beside them. unfinished: matches of an earlier run. keep_doubtful: keep views that others contradict, with
    a warning. names: of the photographs of views, for warnings. stated: where views were taken, as their
    files say; the model comes to lie there, in metres, where they agree with each other.
    """
    require_features(features, blank or {})
    scene = Scene(
        features, rigs, threads, progress, focal_known, known, pictures or {}, brightness or {}, exact,
        unfinished or Unfinished(), focal or {}, stated or {}, {*exact, *steady}, keep_doubtful,
    )  # fmt: skip
    adjusted = _adjusted(scene, cameras)
    if isinstance(adjusted, TurnedViews):
        return _turned(adjusted)
    rungs: tuple[Rung, ...] = ()
    if adjusted.is_fisheye and not any(lens.fisheye for lens in cameras.values()):
        # What no radial terms brought near to its place was dropped meanwhile, at the corners most of all.
        rungs = tuple(rung for rung in adjusted.lens_rungs if rung.name in _LENS_KINDS)
        again = _adjusted(scene, {**cameras, **adjusted.centred(cameras)})
        if isinstance(again, TurnedViews):
            return _turned(again)
        adjusted = again
    if adjusted.metric and not adjusted.free.placed:  # distances are better known now than at first
        for rig in rigs:
            to_metres(
                adjusted.reconstruction, known, [name for name in rig if name not in adjusted.by_motion]
            )
    errors = standard_errors(adjusted.reconstruction, adjusted.free, adjusted.typical, progress)
    if errors is not None:
        errors = errors.without_lenses(adjusted.held)
    doubts = [
        doubt
        for doubt in (
            hanging(adjusted.hanging, names or {}),
            loose({} if errors is None else _turn_errors(adjusted.reconstruction, errors), names or {}),
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
        typical=adjusted.typical,
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
        typical=views.typical,
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


@dataclass(frozen=True, eq=False)
class _Adjusted:
    """A model with the terms of its lenses chosen. free: how it was adjusted; typical: its miss, px;
    metric: its unit is the metre; held: cameras whose lenses stayed as the files say; left_out: views that
    others contradict; hanging: those that one pair holds on the others; by_motion: cameras that are tied by
    it alone."""

    reconstruction: Any
    free: Free
    typical: float
    metric: bool
    held: frozenset[str]
    left_out: frozenset[ViewId]
    hanging: frozenset[ViewId]
    by_motion: frozenset[str]
    rungs: tuple[Rung, ...]
    rig_rung: Rung
    lens_rungs: tuple[Rung, ...]

    @property
    def is_fisheye(self) -> bool:
        """True if the lenses are fisheyes of two terms."""
        return self.free.model == "RADIAL_FISHEYE"

    def centred(self, cameras: Mapping[str, Lens]) -> dict[str, Lens]:
        """Lenses with the principal points of the first guesses."""
        lenses = fields_of(self.reconstruction)["lenses"]
        return {
            name: lens.model_copy(update={"cx": cameras[name].cx, "cy": cameras[name].cy})
            for name, lens in lenses.items()
        }


def _adjusted(scene: Scene, cameras: Mapping[str, Lens]) -> _Adjusted | TurnedViews:
    """Place the views beginning with these lenses, tie rigs together, and choose the lenses' terms.

    Views from one place have their turns instead.
    """
    known, threads, progress = scene.known, scene.threads, scene.progress
    width = max(lens.width for lens in cameras.values())
    max_error = MAX_ERROR * min(max(width / 1280, 0.5), 1.0)
    database = pycolmap.Database.open(":memory:")
    models = {
        name: camera_of(known.lenses[name])
        if name in known.lenses
        else _camera(lens, name in scene.focal_known)
        for name, lens in cameras.items()
    }
    pairs = matched(scene, database, models, max_error)
    turned = turned_views(
        scene.features, pairs, {**cameras, **known.lenses}, known.lenses, scene.focal_known, max_error
    )
    if turned is not None:
        return turned
    first = first_models(scene, database, models, pairs, cameras, max_error)
    # Motion determines the distance of cameras without a common view too badly to scale the scene.
    metric = sum(to_metres(first.main.reconstruction, known, rig) is not None for rig in scene.rigs) > 0
    joined = join(first.main.reconstruction, [one.reconstruction for one in first.apart], scene.rigs)
    free = Free(
        "RADIAL_FISHEYE" if any(lens.fisheye for lens in cameras.values()) else "SIMPLE_RADIAL",
        fixed=camera_numbers(models, {*known.lenses, *first.held}),
        placed=camera_numbers(models, known.cam_from_rig),
        focal=focal_priors(
            {models[name].camera_id: why_fixed for name, why_fixed in scene.focal.items() if name in models}
        ),
    )
    tied = tied_model(scene, database, joined, free, max_error, metric)
    if joined.cameras and not tied.rung.taken:
        rung = unjoined(joined.cameras, tied.rung.reason)
        joined = Joined(first.main.reconstruction, frozenset(), (rung,))
        tied = tied_model(scene, database, joined, free, max_error, metric)
    reconstruction, free, typical = tied.reconstruction, tied.free, tied.typical
    if scene.pictures and reconstruction.num_points3D() >= FEWEST_MATCHES:
        refine_points(reconstruction, scene.pictures, progress)
        typical = polish(reconstruction, free, ALIGNED * max_error, threads, progress)
    if reconstruction.num_points3D() < FEWEST_MATCHES:
        raise CalibrationError(NO_START.format(first.main.pairs))
    free, focal_rungs = settle_focal(
        reconstruction, free, typical, threads, {models[name].camera_id: name for name in models}, scene.focal
    )
    if not metric:
        places, stated_rung = align_to_places(reconstruction, scene.stated)
        if places and tied.uncut is not None:
            align_to_places(tied.uncut, scene.stated)
        free = replace(free, places=places)
        focal_rungs = (*(() if stated_rung is None else (stated_rung,)), *focal_rungs)
        if places:
            adjust(reconstruction, free, typical, threads)
    typical = misses(reconstruction).typical
    why_fixed = "the files gave the lenses" if first.held else "a board gave the lenses"
    free, lens_rungs = climb(reconstruction, free, typical, threads, progress, why_fixed, tied.uncut)
    adjust(reconstruction, free, typical, threads)
    every = [first.main, *(one for one in first.apart if one.cameras <= joined.cameras)]
    return _Adjusted(
        reconstruction,
        free,
        typical,
        metric,
        first.held,
        frozenset().union(*(one.left_out for one in every)),
        frozenset().union(*(one.hanging for one in every)),
        joined.cameras,
        (*(rung for one in every for rung in one.rungs), *joined.rungs, *first.unplaced),
        tied.rung,
        (*focal_rungs, *lens_rungs),
    )


def _camera(lens: Lens, focal_known: bool) -> Any:
    if lens.fisheye:
        return camera_of(lens)
    camera = pycolmap.Camera.create_from_model_name(0, "SIMPLE_RADIAL", lens.fx, lens.width, lens.height)
    camera.has_prior_focal_length = focal_known
    return camera


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

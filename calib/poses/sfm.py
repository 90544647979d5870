"""Structure from motion: poses, lenses and scene points from features, with the rig as a constraint."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from calib.data.features import FEWEST_MATCHES, Features, fill_database
from calib.poses import uncertainty as spreads
from calib.poses.bundle_adjustment import Free, adjust, cut, lens_of, misses
from calib.poses.contradictions import settle
from calib.poses.known_rig import NOTHING, Known, camera_of, to_metres
from calib.poses.lens_ladder import climb, sees_wide
from calib.poses.point_refinement import align
from calib.poses.refusals import refuse_hopeless, refuse_turning
from imaging.errors import CalibrationError
from imaging.files.colmap import pycolmap
from imaging.lens import Lens
from imaging.pose import Pose
from imaging.progress import Progress
from imaging.session.records import Rung
from imaging.session.view_id import ViewId

MAX_ERROR = 4.0
"""Of a correspondence, px, in pictures of 1280 px or wider; less in smaller ones, at least half of it."""
FEWEST_FRAMES = 2
"""Frames that have to show two cameras of a rig before one place of each in the rig is better than two."""
ROUNDS = 4
"""Of adjusting and cutting outliers."""
ALIGNED = 0.4
"""Patches err by less than features, of whose error this is a part."""
LOOSE = 1.5
"""Tied cameras may miss by this much more than free ones; beyond, they are not rigidly mounted."""
_LENS_KINDS = ("lens_radial_1", "lens_radial_2", "lens_tangential", "lens_fisheye")
"""Rungs that a fisheye has behind it."""
_NO_START = (
    "{} pairs of views match, but no two of them give a start from which the others can be placed: take "
    "more views, at most 30 degrees apart, that overlap by two thirds."
)


@dataclass(frozen=True, eq=False)
class Model:
    """What structure from motion found; lenses and errors in pixels of the pictures.

    reconstruction: the pycolmap model. poses: cam_from_world of every registered view. cam_from_rig: of
    every camera, if the rig constraint held. points: scene points that each view sees. rungs: the
    ladder of rig and lens. contradicted: views that were left out because others
    said that their poses were false.
    """

    reconstruction: Any
    lenses: dict[str, Lens]
    poses: dict[ViewId, Pose]
    cam_from_rig: dict[str, Pose]
    points: dict[ViewId, int]
    reprojection_px: float
    rungs: tuple[Rung, ...]
    spread: spreads.Spread | None
    metric: bool
    contradicted: frozenset[ViewId] = frozenset()

    @property
    def rigged(self) -> bool:
        """Whether cameras are tied to each other."""
        return any(rung.name == "rig_constraint" and rung.taken for rung in self.rungs)


def solve(
    features: Mapping[ViewId, Features],
    cameras: Mapping[str, Lens],
    rigs: Sequence[Sequence[str]],
    threads: int,
    progress: Progress,
    *,
    focal_known: Collection[str] = (),
    known: Known = NOTHING,
    blank: Mapping[ViewId, str] | None = None,
    pictures: Mapping[ViewId, bytes] | None = None,
    brightness: Mapping[ViewId, npt.NDArray[np.float64]] | None = None,
    exact: Collection[str] = (),
) -> Model:
    """Place the views. Errors: CalibrationError that names the cause when none can be placed.

    features: of every view, in picture pixels. cameras: a first guess of each lens, at picture size.
    rigs: names of cameras that are rigidly mounted to each other. focal_known: cameras whose guess comes
    from a file's focal length rather than from nothing. known: what a board told, which stays, lenses
    at picture size; the model is in metres where that placed two cameras of a rig. blank: why a view shows
    nothing, of those that do not. pictures: of views with little noise, as grey PNGs, for places more exact
    than those of features.
    """
    refuse_hopeless(features, blank or {})
    width = max(lens.width for lens in cameras.values())
    max_error = MAX_ERROR * min(max(width / 1280, 0.5), 1.0)
    database = pycolmap.Database.open(":memory:")
    models = {
        name: camera_of(known.lenses[name]) if name in known.lenses else _camera(lens, name in focal_known)
        for name, lens in cameras.items()
    }
    pairs = fill_database(database, models, features, max_error, progress)
    if not pairs:
        raise CalibrationError(
            "No two views share enough of the scene to be placed: take views that overlap by two thirds."
        )
    refuse_turning(pairs, cameras, max_error)
    fixed = frozenset(models[name].camera_id for name in known.lenses if name in models)

    def mapped() -> Any | None:
        return _map(database, len(features), max_error, fixed, threads, progress)

    reconstruction = mapped()
    if reconstruction is None or reconstruction.num_points3D() < FEWEST_MATCHES:
        raise CalibrationError(_NO_START.format(len(pairs)))
    settled = settle(database, reconstruction, pairs, brightness or {}, max_error, mapped, exact)
    reconstruction = settled.reconstruction
    alone = misses(reconstruction).typical
    metric = sum(to_metres(reconstruction, known, rig) is not None for rig in rigs) > 0
    loose = pycolmap.Reconstruction(reconstruction)
    uncut = pycolmap.Reconstruction(reconstruction) if sees_wide(reconstruction) else None
    rung = _rig(database, reconstruction, rigs, known)
    placed = frozenset(models[name].camera_id for name in known.cam_from_rig if name in models)
    fisheye = any(lens.fisheye for lens in cameras.values())
    free = Free("RADIAL_FISHEYE" if fisheye else "SIMPLE_RADIAL", fixed=fixed, placed=placed)
    typical = _polish(reconstruction, free, max_error, threads, progress)
    if rung.taken and typical > LOOSE * max(alone, 0.1):
        reconstruction = loose
        reason = (
            f"the cameras moved against each other: tied together, points miss by {typical:.2f} px "
            f"instead of {alone:.2f} px"
        )
        rung = Rung(name="rig_constraint", taken=False, reason=reason)
        free = replace(free, placed=frozenset())
        typical = _polish(reconstruction, free, max_error, threads, progress)
    if pictures and reconstruction.num_points3D() >= FEWEST_MATCHES:
        align(reconstruction, pictures, progress)
        typical = _polish(reconstruction, free, ALIGNED * max_error, threads, progress)
    if reconstruction.num_points3D() < FEWEST_MATCHES:
        raise CalibrationError(_NO_START.format(len(pairs)))
    free, rungs = climb(reconstruction if uncut is None else uncut, free, typical, threads, progress)
    if free.model == "RADIAL_FISHEYE" and not fisheye:
        # What no radial terms brought near to its place was dropped meanwhile, at the corners most of all.
        adjust(reconstruction, free, typical, threads)
        begun = _model(reconstruction, (), None, metric=False).lenses
        centred = {
            name: lens.model_copy(update={"cx": cameras[name].cx, "cy": cameras[name].cy})
            for name, lens in begun.items()
        }
        again = solve(
            features, {**cameras, **centred}, rigs, threads, progress,
            known=known, pictures=pictures, brightness=brightness, exact=exact,
        )  # fmt: skip
        return replace(again, rungs=(*(one for one in rungs if one.name in _LENS_KINDS), *again.rungs))
    adjust(reconstruction, free, typical, threads)
    if metric and not free.placed:  # distances are better known now than at first
        for rig in rigs:
            to_metres(reconstruction, known, rig)
    spread = spreads.measure(reconstruction, free, typical, progress)
    model = _model(reconstruction, (*settled.rungs, rung, *rungs), spread, metric=metric)
    return replace(model, contradicted=settled.left_out)


def _polish(reconstruction: Any, free: Free, max_error: float, threads: int, progress: Progress) -> float:
    """Adjust robustly and drop what misses, a few times; returns the typical miss, px.

    The scale of the loss follows the data: sub-pixel corners deserve more than a fixed pixel.
    """
    typical = 0.125 * max_error
    for turn in range(ROUNDS):
        progress("adjusting", turn, ROUNDS)
        adjust(reconstruction, free, typical, threads)
        typical = cut(reconstruction, least=0.15 * max_error)
    progress("adjusting", ROUNDS, ROUNDS)
    return typical


def _camera(lens: Lens, focal_known: bool) -> Any:
    if lens.fisheye:
        return camera_of(lens)
    camera = pycolmap.Camera.create_from_model_name(0, "SIMPLE_RADIAL", lens.fx, lens.width, lens.height)
    camera.has_prior_focal_length = focal_known
    return camera


def _map(
    database: Any, views: int, max_error: float, fixed: frozenset[int], threads: int, progress: Progress
) -> Any | None:
    options = pycolmap.IncrementalPipelineOptions()
    options.constant_cameras = set(fixed)
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


def _rig(database: Any, reconstruction: Any, rigs: Sequence[Sequence[str]], known: Known) -> Rung:
    """Tie the cameras of each rig together.

    Those whose places are known; else those that several frames show with a common reference camera.
    """
    frames: dict[str, set[int]] = {}
    for index in reconstruction.reg_image_ids():
        view = ViewId.of_image(reconstruction.image(index).name)
        frames.setdefault(view.camera, set()).add(view.frame)
    configs = []
    for names in rigs:
        seen = [name for name in names if name in frames]
        told = [name for name in seen if name in known.cam_from_rig]
        tied = {
            name: [other for other in seen if len(frames[other] & frames[name]) >= FEWEST_FRAMES]
            for name in seen
        }
        if len(told) > 1:
            tied = dict.fromkeys(told, told)
        reference = max(seen, key=lambda name: len(tied[name]), default=None)
        if reference is None or len(tied[reference]) < 2:
            continue
        members = []
        for name in tied[reference]:
            member = pycolmap.RigConfigCamera()
            member.image_prefix = f"{name}/"
            member.ref_sensor = name == reference
            if len(told) > 1 and name != reference:
                here, there = (known.cam_from_rig[one].matrix() for one in (name, reference))
                member.cam_from_rig = pycolmap.Rigid3d((here @ np.linalg.inv(there))[:3])
            members.append(member)
        config = pycolmap.RigConfig()
        config.cameras = members
        configs.append(config)
    if not configs:
        reason = f"no {FEWEST_FRAMES} frames show two cameras of one rig together"
        return Rung(name="rig_constraint", taken=False, reason=reason)
    pycolmap.apply_rig_config(configs, database, reconstruction)
    reason = "the session says that the cameras are mounted to each other, and several frames show them so"
    if known.cam_from_rig:
        reason = "a board told where the cameras are mounted"
    return Rung(name="rig_constraint", taken=True, reason=reason)


def _model(
    reconstruction: Any, rungs: tuple[Rung, ...], spread: spreads.Spread | None, *, metric: bool
) -> Model:
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
    return Model(
        reconstruction, lenses, poses, mounted, points,
        float(reconstruction.compute_mean_reprojection_error()), rungs, spread, metric,
    )  # fmt: skip


def pose_of(motion: Any) -> Pose:
    """A pycolmap.Rigid3d as a Pose."""
    x, y, z, w = (float(value) for value in motion.rotation.quat)
    a, b, c = (float(value) for value in motion.translation)
    return Pose(quaternion=(w, x, y, z), translation=(a, b, c))


def centres(poses: Sequence[Pose]) -> npt.NDArray[np.float64]:
    """Camera centres [N, 3] of cam_from_world poses."""
    matrices = np.stack([pose.matrix() for pose in poses])
    return np.asarray(-np.einsum("nji,nj->ni", matrices[:, :3, :3], matrices[:, :3, 3]))

"""Poses of a session's views, by SIFT's features, and by further ones where these leave many out."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import partial
from importlib.metadata import version

from calib import view_images
from calib.boards.measure import picture_of
from calib.data import learned
from calib.data.features import MORE_FEATURES, MOST_FEATURES, FeatureKind, enough_features
from calib.data.unfinished import Unfinished
from calib.data.views import steady_cameras
from calib.evidence import Evidence
from calib.poses import moving, sfm
from calib.poses.pose_inputs import PoseInputs
from calib.poses.refusals import OnePlace
from calib.poses.resolution import CHECK, DOUBTS, Contradicted
from calib.poses.rigs.known_rig import KnownRig
from calib.poses.rigs.rig_placement import place_by_rig
from calib.survey.locate import located
from calib.survey.stated_positions import stated_places
from calib.turntable.angles import with_angles
from calib.view_images import ViewSummary
from imaging.errors import CalibrationError
from imaging.progress import Progress
from imaging.session.calibration import TURNED
from imaging.session.coordinates import CoordinateSystem
from imaging.session.records import Rung
from imaging.session.view_id import ViewId

FURTHER: dict[FeatureKind, str] = {"more": "more_features", "learned": "learned_matching"}
WORDS: dict[FeatureKind, str] = {
    "more": f"up to {MORE_FEATURES:,} features an image for {MOST_FEATURES:,}",
    "learned": "learned features (DISK, matched by LightGlue)",
}
FEW = 0.8
"""Share of the images that show something; further features are tried where SIFT's place fewer, since they
double the seconds or more. In 2 of 7 sets and subsets below it, more features placed more views (flight: 6
instead of 0 of 6; fruit: 7 instead of 6 of 8); above it, in none of 4
(`bench/real/poses/more_features.py`).
"""
LEAST_SIDE = 16
"""px; nothing can be found in narrower pictures, and what reduces them is made for no such strips."""


@dataclass(frozen=True, eq=False)
class Placement:
    """Placed views of a session.

    Attributes:
        model: Poses, lenses and scene points.
        summaries: Features of every view, from which it was made, and the brightness around them.
        by_rig: Views placed by their rig alone.
        coordinates: Coordinates that the model is in; None: its own.
    """

    model: sfm.SceneModel
    summaries: Mapping[ViewId, ViewSummary]
    by_rig: Collection[ViewId]
    coordinates: CoordinateSystem | None


def place_views(
    evidence: Evidence, unfinished: Unfinished, keep_doubtful: bool, progress: Progress
) -> Placement:
    """Place the views of a session, in the best coordinates available.

    Args:
        evidence: Views, their sensors and light, and the coordinates that are wanted.
        unfinished: Store of features and matches of an interrupted run.
        keep_doubtful: True to keep views that others contradict.
        progress: Callback for the current step, the steps done, and all of them.

    Returns:
        The placed views.

    Raises:
        CalibrationError: No view can be placed, or a photograph is too small.
    """
    session = evidence.session
    summaries = view_images.summaries(evidence, unfinished, progress)
    model, summaries = _by_features(evidence, summaries, unfinished, keep_doubtful, progress)
    if _taken(model, TURNED):
        if evidence.control is not None or evidence.target is not None:
            raise CalibrationError(
                "All views were taken from one place, so that coordinates cannot be given to it: leave "
                "--survey and --onto out, or take views from several places."
            )
        return Placement(model, summaries, (), None)
    model, coordinates = located(
        session,
        evidence.views,
        model,
        {view: summary.features for view, summary in summaries.items()},
        evidence.control,
        evidence.target,
        partial(picture_of, session),
        progress,
    )
    # Views that show too little stand where the others of their rig say.
    rigs = {camera.name: camera.rig for camera in session.record.cameras if camera.rig is not None}
    model, by_rig = place_by_rig(model, summaries, rigs)
    turntable = session.turntable()
    if turntable is not None:
        model = with_angles(model, summaries, turntable)
    shots = [shot for view in evidence.views for shot in view.shots]
    model = replace(model, rungs=(*model.rungs, *moving.rungs(shots)))
    return Placement(model, summaries, by_rig, coordinates)


def require_sizes(evidence: Evidence) -> None:
    """Raise CalibrationError for the first photograph that is smaller than any that could be placed."""
    for shot in (shot for view in evidence.views for shot in view.shots):
        if min(shot.width, shot.height) < LEAST_SIDE:
            raise CalibrationError(
                f"{evidence.session.folder}: {shot.file} has {shot.width}x{shot.height} pixels, and views "
                f"need {LEAST_SIDE} on a side at least: import the session again without its camera "
                f"{shot.camera}."
            )


def cache_key(evidence: Evidence) -> list[object]:
    """List all that features and matches follow from."""
    session, shots = evidence.session, [shot for view in evidence.views for shot in view.shots]
    masks = {path: path.stat() for path in map(session.mask, shots) if path is not None and path.is_file()}
    return [
        {name: version(name) for name in ("hdr-rig", "pycolmap", "numpy")},
        [shot.model_dump(mode="json") for shot in shots],
        [(path.name, stat.st_size, stat.st_mtime_ns) for path, stat in masks.items()],
        [evidence.light.scale[shot.file] for shot in shots],
        {name: response.model_dump(mode="json") for name, response in evidence.light.responses.items()},
        repr(evidence.sensors),
    ]


def _by_features(
    evidence: Evidence,
    summaries: dict[ViewId, ViewSummary],
    unfinished: Unfinished,
    keep_doubtful: bool,
    progress: Progress,
) -> tuple[sfm.SceneModel, dict[ViewId, ViewSummary]]:
    """Place the views by SIFT's features, and by more or learned ones where these leave many out.

    Further features are taken if they place more views. Where views contradict each other they are no way
    out, since they match what only looks alike as well, nor where all views were taken from one place.

    Returns:
        The model, and the summaries that it was made of.
    """
    model, refusal = None, None
    try:
        model = _solved(evidence, summaries, unfinished, keep_doubtful, progress)
    except (Contradicted, OnePlace):
        raise
    except CalibrationError as error:
        refusal = error
    showing = [view for view, summary in summaries.items() if summary.blank is None]
    # Images below the feature limit have no further features to find.
    richer = [_is_rich(summaries[view]) for view in showing]
    further: list[FeatureKind] = ["more"] if 2 * sum(richer) > len(richer) else []
    further += ["learned"] if learned.available() else []
    for kind in further:
        held, placed = _held(model)
        if held >= FEW * len(showing) or (model is not None and _taken(model, CHECK)):
            continue
        others = view_images.summaries(evidence, unfinished, progress, kind)
        try:
            another = _solved(evidence, others, unfinished, keep_doubtful, progress)
        except CalibrationError:
            continue
        if _held(another) > (held, placed) and not _taken(another, CHECK, *DOUBTS):
            without, now = (
                f"{total}{f' ({total - sure} by one pair only)' if total > sure else ''}"
                for sure, total in ((held, placed), _held(another))
            )
            reason = f"{without} of {len(showing)} images are placed without, {now} with {WORDS[kind]}"
            rung = Rung(name=FURTHER[kind], taken=True, reason=reason)
            model, summaries = replace(another, rungs=(*another.rungs, rung)), others
    if model is None:
        assert refusal is not None
        raise refusal
    return model, summaries


def _is_rich(summary: ViewSummary) -> bool:
    """Return whether a picture has as many features as end the search for smaller ones."""
    return len(summary.features.points) >= enough_features(summary.width * summary.height)


def _held(model: sfm.SceneModel | None) -> tuple[int, int]:
    """Numbers of the views that more than one pair holds, and of all that are placed."""
    return (0, 0) if model is None else (len(model.poses) - len(model.hanging), len(model.poses))


def _taken(model: sfm.SceneModel, *names: str) -> bool:
    """Return whether one of these rungs was taken."""
    return any(rung.taken and rung.name in names for rung in model.rungs)


def _solved(
    evidence: Evidence,
    summaries: Mapping[ViewId, ViewSummary],
    unfinished: Unfinished,
    keep_doubtful: bool,
    progress: Progress,
) -> sfm.SceneModel:
    cameras, board = evidence.session.record.cameras, evidence.board
    sizes = {view.camera: (summary.width, summary.height) for view, summary in summaries.items()}
    rigs: dict[str, list[str]] = {}
    for camera in cameras:
        if camera.rig is not None and camera.name in sizes:
            rigs.setdefault(camera.rig, []).append(camera.name)
    guesses = {name: evidence.sensors[name].lens.resized(*size) for name, size in sizes.items()}
    focal = {
        name: prior.resized(sizes[name][0] / evidence.sensors[name].lens.width)
        for name in sizes
        if (prior := evidence.sensors[name].focal) is not None
    }
    places = {camera.name: camera.position for camera in cameras if camera.position is not None}
    known = KnownRig(places=places)
    if board is not None:
        lenses = {name: lens.resized(*sizes[name]) for name, lens in board.lenses.items() if name in sizes}
        guesses |= lenses
        focal = {name: prior for name, prior in focal.items() if name not in lenses}
        sure = {name: lens for name, lens in lenses.items() if name in board.sure_lenses}
        # A board measures the distances of cameras better than a ruler, and in axes of its own.
        for names in rigs.values():
            measured = {name: board.place(name) for name in names if name in board.cam_from_rig}
            if len(measured) > 1:
                places = {name: place for name, place in places.items() if name not in names} | measured
        known = KnownRig(sure, board.cam_from_rig if board.sure_rig else {}, places)
    inputs = PoseInputs(
        {view: summary.features for view, summary in summaries.items()},
        list(rigs.values()),
        threads=1,  # Ceres adds up in the order in which its threads finish
        progress=progress,
        focal=focal,
        stated=stated_places(evidence.session, evidence.views),
        focal_known={*focal, *(() if board is None else board.lenses)},
        known=known,
        blank={view: summary.blank for view, summary in summaries.items() if summary.blank is not None},
        pictures={view: summary.png for view, summary in summaries.items() if not summary.faint},
        brightness={view: summary.brightness for view, summary in summaries.items()},
        exact={camera.name for camera in cameras if camera.kind == "raw"},
        steady=steady_cameras(evidence.views),
        unfinished=unfinished,
        keep_doubtful=keep_doubtful,
        names=evidence.session.photograph_names(),
        turntable=evidence.session.turntable() is not None,
    )
    return sfm.solve(inputs, guesses)

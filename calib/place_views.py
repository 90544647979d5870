"""Poses of a session's views, and the lenses, falloff and colours that follow from them."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from importlib.metadata import version
from statistics import median

from calib import all_views
from calib.assemble import Evidence, Placement, assemble
from calib.boards.measure import picture_of
from calib.colour.recorded import balance, with_balance, with_development
from calib.colour.white_balance import Balance
from calib.data import learned
from calib.data.features import ENOUGH_FEATURES, MORE_FEATURES, MOST_FEATURES, FeatureKind
from calib.data.unfinished import Unfinished
from calib.data.views import steady_cameras
from calib.exports import pictures
from calib.exports.output import write_calibration
from calib.light import each_photograph, tracks, vignetting
from calib.light.parts import ASKED
from calib.light.photograph_sights import sights_of
from calib.light.stated import stated_by
from calib.luminance.measure import scaled
from calib.poses import moving, sfm
from calib.poses.known_rig import KnownRig
from calib.poses.refusals import OnePlace
from calib.poses.resolution import CHECK, DOUBTS, Contradicted
from calib.poses.rig_placement import place_by_rig
from calib.survey.locate import located
from calib.survey.stated import stated_places
from calib.view_images import ViewSummary
from imaging.errors import CalibrationError, InputError, PartialError
from imaging.plates.middle_grey import lasting_factor
from imaging.progress import Progress
from imaging.session.calibration import CalibrationRecord, read_calibration
from imaging.session.records import Rung
from imaging.session.session import Session
from imaging.session.view_id import ViewId

FURTHER: dict[FeatureKind, str] = {"more": "more_features", "learned": "learned_matching"}
WORDS: dict[FeatureKind, str] = {
    "more": f"{MORE_FEATURES:,} features an image for {MOST_FEATURES:,}",
    "learned": "learned features (DISK, matched by LightGlue)",
}
FEW = 0.8
"""Share of the images that show something; learned features are tried where SIFT's place fewer."""


LEAST_SIDE = 16
"""px; nothing can be found in narrower pictures, and what reduces them is made for no such strips."""


def with_poses(
    evidence: Evidence, board_refused: str, keep_doubtful: bool, progress: Progress
) -> CalibrationRecord:
    """Place the views and write the calibration, which is returned.

    board_refused: why shots of a board gave nothing. keep_doubtful: keep views that others contradict.
    CalibrationError when no view can be placed and nothing else was learnt, or an earlier calibration has
    poses; PartialError when only the rest could be written.
    """
    session = evidence.session
    _check_sizes(evidence)
    unfinished = Unfinished(session.folder, _question(evidence))
    summaries = all_views.summaries(evidence, unfinished, progress)
    try:
        # One thread: Ceres adds up in the order in which its threads finish.
        model, summaries = _placed(evidence, summaries, unfinished, keep_doubtful, progress)
    except CalibrationError as error:
        unfinished.finish()
        cause = f"{str(error)[0].lower()}{str(error)[1:]}"
        measured = _measured_without_poses(evidence)
        if not measured or _has_poses(session):
            raise CalibrationError(f"{session.folder}: {cause}") from error
        write_calibration(session, with_scales(assemble(evidence), evidence), (), None, progress)
        also = f" The board was left out: {board_refused}" if board_refused else ""
        raise PartialError(f"{session.folder}: {measured}, but no view has a pose: {cause}{also}") from error
    rigs = {camera.name: camera.rig for camera in session.record.cameras if camera.rig is not None}
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
    model, by_rig = place_by_rig(model, summaries, rigs)
    shots = [shot for view in evidence.views for shot in view.shots]
    model = replace(model, rungs=(*model.rungs, *moving.rungs(shots)))
    names = sorted(model.lenses)
    progress("measuring falloff", 0, 1)
    brightness = {view: summary.brightness for view, summary in summaries.items()}
    colours = {view: summary.colour for view, summary in summaries.items()}
    photographs = {camera.name for camera in session.record.cameras if camera.kind == "ldr"}
    development, stated = each_photograph.Development({}, {}), stated_by(session, evidence.views)
    without = evidence.without
    if photographs:
        sights = sights_of(model, colours, photographs, None)
        development = each_photograph.estimate(*sights, stated, without)
        brightness = development.brightness(brightness)
    through = {view.camera.name: frozenset(shot.band for shot in view.shots) for view in evidence.views}
    filters = list(dict.fromkeys(through[name] for name in names))
    falloff = vignetting.estimate(
        tracks.tracks_of(model, brightness, names).apart([filters.index(through[name]) for name in names]),
        names,
        {camera.name: f"{camera.make} {camera.model}" for camera in session.record.cameras},
        comparable=len(filters) == 1,
        uncorrected={
            camera.name: vignetting.natural(model.lenses[camera.name])
            for camera in session.record.cameras
            if camera.kind == "raw" and camera.name in model.lenses
        },
        without=without,
    )
    if development.differs:
        # The first estimate took the falloff for part of what photographs differ by.
        sights = sights_of(model, colours, photographs, falloff)
        development = each_photograph.estimate(*sights, stated, without)
    white = Balance({}, {}, (Rung(name="white_balance", taken=False, reason=ASKED),))
    if "white_balance" not in without:
        white = balance(model, colours, evidence.sensors, falloff, list(evidence.charts.evidence))
    record = with_balance(assemble(evidence, Placement(model, falloff, by_rig, coordinates)), white)
    if photographs:
        record = with_development(record, development, evidence.views)
    record = with_scales(record, evidence)
    factor = pictures.exposure(brightness)
    sizes = {view: (summary.width, summary.height) for view, summary in summaries.items()}
    shown = all_views.shown(evidence, record, sizes, factor)
    write_calibration(session, record, shown, model, progress)
    unfinished.finish()
    return record


def _check_sizes(evidence: Evidence) -> None:
    """Raise CalibrationError for the first photograph that is smaller than any that could be placed."""
    for shot in (shot for view in evidence.views for shot in view.shots):
        if min(shot.width, shot.height) < LEAST_SIDE:
            raise CalibrationError(
                f"{evidence.session.folder}: {shot.file} has {shot.width}x{shot.height} pixels, and views "
                f"need {LEAST_SIDE} on a side at least: import the session again without its camera "
                f"{shot.camera}."
            )


def with_scales(record: CalibrationRecord, evidence: Evidence) -> CalibrationRecord:
    """Add the scale of the light to the record, by the readings of the evidence, else by those of the earlier
    calibration, and the factor that shows it as middle grey.
    """
    session, earlier = evidence.session, None
    if (session.folder / "calibration" / "calibration.json").exists():
        earlier = read_calibration(session.folder)
    factor = lasting_factor(session, record, None if earlier is None else earlier.exposure_factor)
    record = record.model_copy(update={"exposure_factor": factor})
    before = None if earlier is None or evidence.readings is not None else earlier.luminance
    return scaled(session, record, evidence.readings, before)


def _question(evidence: Evidence) -> list[object]:
    """All that features and matches follow from."""
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


def _placed(
    evidence: Evidence,
    summaries: dict[ViewId, ViewSummary],
    unfinished: Unfinished,
    keep_doubtful: bool,
    progress: Progress,
) -> tuple[sfm.SceneModel, dict[ViewId, ViewSummary]]:
    """Place the views by SIFT's features, and by more or learned ones where these leave views out.

    Further features are taken if they place more views. Where views contradict each other they are no way
    out, since they match what only looks alike as well, nor where all views were taken from one place.

    Returns:
        The model, and the summaries that it was made of.
    """
    model, refusal = None, None
    try:
        model = _solved(evidence, summaries, 1, unfinished, keep_doubtful, progress)
    except (Contradicted, OnePlace):
        raise
    except CalibrationError as error:
        refusal = error
    showing = [view for view, summary in summaries.items() if summary.blank is None]
    number = median([len(summaries[view].features.points) for view in showing] or [0])
    # Of pictures that have no more features than they may have, there are no more to be had.
    further: list[tuple[FeatureKind, float]] = [("more", 1.0)] if number >= ENOUGH_FEATURES else []
    further += [("learned", FEW)] if learned.available() else []
    for kind, least in further:
        held, placed = _held(model)
        if held >= least * len(showing) or (model is not None and _taken(model, CHECK)):
            continue
        others = all_views.summaries(evidence, unfinished, progress, kind)
        try:
            another = _solved(evidence, others, 1, unfinished, keep_doubtful, progress)
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


def _held(model: sfm.SceneModel | None) -> tuple[int, int]:
    """Numbers of the views that more than one pair holds, and of all that are placed."""
    return (0, 0) if model is None else (len(model.poses) - len(model.hanging), len(model.poses))


def _taken(model: sfm.SceneModel, *names: str) -> bool:
    """Return whether one of these rungs was taken."""
    return any(rung.taken and rung.name in names for rung in model.rungs)


def _solved(
    evidence: Evidence,
    summaries: Mapping[ViewId, ViewSummary],
    threads: int,
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
        # A board measures the distances of cameras better than a ruler.
        places |= {name: board.place(name) for name in board.cam_from_rig}
        known = KnownRig(sure, board.cam_from_rig if board.sure_rig else {}, places)
    return sfm.solve(
        {view: summary.features for view, summary in summaries.items()},
        guesses,
        list(rigs.values()),
        threads,
        progress,
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
    )


def _measured_without_poses(evidence: Evidence) -> str:
    """Return the results that need no pose, as the beginning of a sentence; empty without any."""
    parts = {
        "exposures and response": evidence.light.measured,
        "the board's lenses": evidence.board is not None,
        "sensors": evidence.has_sensor_frames,
        "colours": bool(evidence.charts.evidence),
    }
    measured = ", ".join(part for part, there in parts.items() if there)
    if measured:
        return f"{measured} are measured"
    named = any(sensor.camera_from_rec709 is not None for sensor in evidence.sensors.values())
    return "colours are as the files say" if named else ""


def _has_poses(session: Session) -> bool:
    try:
        return bool(read_calibration(session.folder).views)
    except InputError:
        return False

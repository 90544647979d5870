"""A session's calibration, from its own pictures: exposures, response, poses, lenses, falloff."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

from calib.assemble import assemble
from calib.boards.measure import Measured as MeasuredBoard
from calib.boards.measure import measure as measure_board
from calib.colour.measure import Charts, measure_charts
from calib.colour.recorded import CHART_RUNGS, balance, charts_of, rebalanced, with_balance, with_charts
from calib.data.views import View, scene_views
from calib.exports import pictures
from calib.exports.output import write_calibration
from calib.light import radiometry, tracks, vignetting
from calib.light.radiometry import Light
from calib.light.response import RUNGS
from calib.poses import sfm
from calib.poses.known_rig import Known
from calib.poses.rig_placement import place
from calib.sensor import metadata
from calib.sensor.measure import Sensors, measure
from calib.sensor.metadata import Sensor
from calib.sensor.rungs import NAMES
from calib.view_images import Look, look
from imaging.compute.cores import available_cores
from imaging.errors import CalibrationError, InputError, PartialError
from imaging.files import store
from imaging.progress import Progress, unreported
from imaging.session.calibration import CalibrationRecord, is_stale, read_calibration
from imaging.session.records import Board, ShotRecord
from imaging.session.session import Session
from imaging.session.view_id import ViewId

Part = Literal["sensor", "response", "colour", "poses"]

_PARTS: dict[Part, frozenset[str]] = {
    "sensor": NAMES,
    "colour": frozenset({"camera_colour", *CHART_RUNGS}),
    "response": frozenset({*RUNGS, "exposure_ratios", "exposure_per_shot"}),
}
"""The rungs that belong to each part but the poses, which all others belong to."""


def calibrate(
    session: str | Path,
    *,
    only: Part | None = None,
    board: Board | None = None,
    chart: bool = False,
    progress: Progress = unreported,
) -> CalibrationRecord:
    """Calibrate a session and write its `calibration/` folder; returns what was written.

    only: redo this part and keep the rest of the calibration that is there; all but 'poses' need no
    poses. board: what the session's shots of a board show, where it does not say so itself. chart: search
    the views for a colour chart, and measure colours by it. The folder is replaced as a whole or not at
    all. Views without a pose are listed in the record.

    Errors: CalibrationError when no view can be placed and nothing else was learnt, or when an earlier
    calibration has poses, which then stays; PartialError when the board or the poses had to be left out of
    what is written; InputError for a damaged session; StorageError.
    """
    session = Path(session)
    opened = Session.open(session)
    store.require_writable(session / "calibration")
    # Darks and flats alone tell of the sensor, a board alone of lenses and rig.
    alone = only == "sensor" or (only in (None, "poses") and bool(opened.shots("board")))
    views = scene_views(opened) if opened.shots("scene") or not alone else []
    earlier = _earlier(opened, only)
    if earlier is not None and only in ("response", "colour"):
        measured = {camera.name: Sensors(at=camera.sensors) for camera in earlier.cameras}
    else:
        measured = measure(opened, views, progress)
    found = _sensors(opened, views, measured)
    views = [replace(view, sensors=found[view.camera.name].measured.at) for view in views]
    if only in ("poses", "sensor") and earlier is not None:
        light = _known_light(earlier)
    else:
        light = radiometry.measure(opened, views, progress)
    charts = charts_of(earlier) if only == "poses" and earlier is not None else Charts()
    if chart:
        if only not in (None, "colour"):
            raise InputError(f"a chart tells of colour, not of {only}: leave --chart or --only {only} out.")
        charts = measure_charts(opened, views, found, light, earlier, progress)
    found = charts.applied(found)
    if only is not None and only != "poses":
        record = _with_part(opened, views, only, found, light, charts, earlier)
        store.write_json(_folder(opened) / "calibration.json", record.model_dump(mode="json"))
        return record
    known, refused = _board(opened, board, progress)
    if views:
        record = _with_poses(opened, views, found, light, charts, known, refused, progress)
    elif known is None and not _has_sensor_frames(opened):
        raise CalibrationError(refused)
    else:
        record = with_charts(assemble(opened, views, found, light, board=known), charts)
        write_calibration(opened, record, (), None, progress)
    if refused:
        raise PartialError(f"{session}: the board was left out, and the rest is calibrated: {refused}")
    return record


def _board(session: Session, told: Board | None, progress: Progress) -> tuple[MeasuredBoard | None, str]:
    """What the session's shots of a board gave, or why they gave nothing: the rest does not hang on it.

    told: what they show; a board that was told once is known from the calibration that there is.
    """
    if told is None and (_folder(session) / "calibration.json").exists():
        evidence = read_calibration(session.folder).board
        told = None if evidence is None else evidence.board
    try:
        return measure_board(session, told, progress), ""
    except CalibrationError as error:
        return None, str(error)


def _folder(session: Session) -> Path:
    return session.folder / "calibration"


def _earlier(session: Session, only: Part | None) -> CalibrationRecord | None:
    """The calibration that `only` keeps the rest of; InputError when it belongs to other shots."""
    if only is None or not (_folder(session) / "calibration.json").exists():
        return None
    record = read_calibration(session.folder)
    if is_stale(session.folder, record):
        raise InputError(
            f"{_folder(session)} is older than the shots of the session: run `rig calibrate` without --only."
        )
    return record


def _sensors(session: Session, views: Sequence[View], measured: Mapping[str, Sensors]) -> dict[str, Sensor]:
    """Every camera that has shots, by its first shot of the scene, or of whatever else."""
    first: dict[str, ShotRecord] = {}
    for shot in [*(view.shots[0] for view in views), *session.shots()]:
        first.setdefault(shot.camera, shot)
    found = {}
    for name, shot in first.items():
        sensor = metadata.describe(session, session.camera(name), shot)
        iso = None if shot.exposure is None else shot.exposure.iso
        found[name] = metadata.with_measured(sensor, measured.get(name, Sensors()), iso)
    return found


def _known_light(record: CalibrationRecord) -> Light:
    return Light(
        scale=dict(record.exposure_scale),
        responses={camera.name: camera.response for camera in record.cameras},
        rungs=tuple(rung for rung in record.rungs if rung.name in _PARTS["response"]),
        measured=False,
    )


def _with_poses(
    session: Session,
    views: Sequence[View],
    found: Mapping[str, Sensor],
    light: Light,
    charts: Charts,
    board: MeasuredBoard | None,
    board_refused: str,
    progress: Progress,
) -> CalibrationRecord:
    threads = available_cores()
    looks: dict[ViewId, Look] = {}
    for done, view in enumerate(views):
        progress("finding features", done, len(views))
        name = view.camera.name
        looks[view.id] = look(
            session, view, light.scale, light.responses[name], found[name].camera_from_rec709, threads
        )
    progress("finding features", len(views), len(views))
    try:
        # One thread: Ceres adds up in the order in which its threads finish.
        model = _placed(session, looks, found, board, 1, progress)
    except CalibrationError as error:
        cause = f"{str(error)[0].lower()}{str(error)[1:]}"
        gained = _gained(session, found, light, charts, board)
        if not gained or _has_poses(session):
            raise CalibrationError(f"{session.folder}: {cause}") from error
        record = with_charts(assemble(session, views, found, light, board=board), charts)
        write_calibration(session, record, (), None, progress)
        also = f" The board was left out: {board_refused}" if board_refused else ""
        raise PartialError(f"{session.folder}: {gained}, but no view has a pose: {cause}{also}") from error
    rigs = {camera.name: camera.rig for camera in session.record.cameras if camera.rig is not None}
    model, by_rig = place(model, looks, rigs)
    names = sorted(model.lenses)
    progress("measuring falloff", 0, 1)
    falloff = vignetting.estimate(
        tracks.tracks_of(model, {view: own.brightness for view, own in looks.items()}, names),
        names,
        {camera.name: f"{camera.make} {camera.model}" for camera in session.record.cameras},
    )
    equal = balance(
        model, {view: own.colour for view, own in looks.items()}, found, falloff, list(charts.evidence)
    )
    record = with_charts(assemble(session, views, found, light, model, falloff, board, by_rig), charts)
    record = with_balance(record, equal)
    factor = pictures.exposure({view: own.brightness for view, own in looks.items()})
    shown = (
        (
            view.id,
            pictures.picture(
                session,
                view,
                light.scale,
                light.responses[view.camera.name],
                record.camera(view.camera.name).camera_from_rec709,
                (looks[view.id].width, looks[view.id].height),
                factor,
            ),
        )
        for view in views
    )
    write_calibration(session, record, shown, model, progress)
    return record


def _has_sensor_frames(session: Session) -> bool:
    return bool(session.shots("dark") or session.shots("flat"))


def _gained(
    session: Session,
    found: Mapping[str, Sensor],
    light: Light,
    charts: Charts,
    board: MeasuredBoard | None,
) -> str:
    """What there is without any pose, as the beginning of a sentence; empty if there is nothing."""
    parts = {
        "exposures and response": light.measured,
        "the board's lenses": board is not None,
        "sensors": _has_sensor_frames(session),
        "colours": bool(charts.evidence),
    }
    measured = ", ".join(part for part, there in parts.items() if there)
    if measured:
        return f"{measured} are measured"
    named = any(own.camera_from_rec709 is not None for own in found.values())
    return "colours are as the files say" if named else ""


def _placed(
    session: Session,
    looks: Mapping[ViewId, Look],
    found: Mapping[str, Sensor],
    board: MeasuredBoard | None,
    threads: int,
    progress: Progress,
) -> sfm.Model:
    sizes = {view.camera: (own.width, own.height) for view, own in looks.items()}
    rigs: dict[str, list[str]] = {}
    for camera in session.record.cameras:
        if camera.rig is not None and camera.name in sizes:
            rigs.setdefault(camera.rig, []).append(camera.name)
    guesses = {camera: found[camera].lens.resized(*size) for camera, size in sizes.items()}
    focal_known = {camera for camera, sensor in found.items() if sensor.focal_known}
    places = {c.name: c.position for c in session.record.cameras if c.position is not None}
    known = Known(places=places)
    if board is not None:
        lenses = {name: lens.resized(*sizes[name]) for name, lens in board.lenses.items() if name in sizes}
        guesses |= lenses
        sure = {name: lens for name, lens in lenses.items() if name in board.sure_lenses}
        # A board measures the distances of cameras better than a ruler.
        places |= {name: board.place(name) for name in board.cam_from_rig}
        known = Known(sure, board.cam_from_rig if board.sure_rig else {}, places)
    return sfm.solve(
        {view: own.features for view, own in looks.items()},
        guesses,
        list(rigs.values()),
        threads,
        progress,
        focal_known=focal_known if board is None else focal_known | set(board.lenses),
        known=known,
        blank={view: own.blank for view, own in looks.items() if own.blank is not None},
        pictures={view: own.png for view, own in looks.items() if not own.faint},
        brightness={view: own.brightness for view, own in looks.items()},
        exact={camera.name for camera in session.record.cameras if camera.kind == "raw"},
    )


def _has_poses(session: Session) -> bool:
    try:
        return bool(read_calibration(session.folder).views)
    except InputError:
        return False


def _with_part(
    session: Session,
    views: Sequence[View],
    only: Part,
    found: Mapping[str, Sensor],
    light: Light,
    charts: Charts,
    earlier: CalibrationRecord | None,
) -> CalibrationRecord:
    """An earlier calibration with one part of it measured again; without one, that part and what it needs."""
    fresh = with_charts(assemble(session, (), found, light), charts)
    if earlier is None:
        return fresh
    fields = {
        "colour": ("camera_from_rec709", "chart"),
        "response": ("response",),
        "sensor": ("noise", "sensors"),
    }
    cameras = []
    for camera in earlier.cameras:
        own = found.get(camera.name)
        flat = only == "sensor" and own is not None and own.measured.falloff is not None
        redone = (*fields[only], "vignetting") if flat else fields[only]
        new = fresh.camera(camera.name)
        cameras.append(camera.model_copy(update={field: getattr(new, field) for field in redone}))
    kept = [rung for rung in earlier.rungs if rung.name not in _PARTS[only]]
    update: dict[str, object] = {
        "created": fresh.created,
        "versions": fresh.versions,
        "cameras": tuple(cameras),
        "rungs": (*(rung for rung in fresh.rungs if rung.name in _PARTS[only]), *kept),
    }
    if only == "response":
        update["exposure_scale"] = fresh.exposure_scale
    record = earlier.model_copy(update=update)
    return rebalanced(record) if only == "colour" else record

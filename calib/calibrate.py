"""A session's calibration, from its own pictures: exposures, response, poses, lenses, falloff."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any, Literal, get_args

from calib.assemble import Evidence, assemble
from calib.boards.measure import measure_board
from calib.colour import unfiltered
from calib.colour.measure import Charts, measure_charts
from calib.colour.recorded import CHART_RUNGS, charts_of, rebalanced
from calib.data.views import View, scene_views
from calib.exports.output import write_calibration
from calib.light import radiometry
from calib.light.parts import LightPart
from calib.light.radiometry import LIGHT_RUNGS, light_of
from calib.luminance.area import require_places
from calib.luminance.measure import RUNG
from calib.place_views import with_poses, with_scales
from calib.request import CalibrationRequest, Part
from calib.sensor import metadata
from calib.sensor.measure import MeasuredSensor, measure_sensors
from calib.sensor.metadata import CameraSensor
from calib.sensor.rungs import NAMES
from calib.survey import onto as onto_session
from calib.survey import placing
from calib.survey.control import Control, control_of, read_control
from calib.survey.onto import Target, read_target
from imaging.arguments import checked
from imaging.compute.threads import one_thread_a_product
from imaging.errors import CalibrationError, InputError, PartialError
from imaging.files import store
from imaging.progress import Progress, unreported
from imaging.request import forgets, value_of
from imaging.session.calibration import COLOUR, CalibrationRecord, is_stale, read_calibration
from imaging.session.luminance import LuminanceReading
from imaging.session.records import Board, ShotRecord
from imaging.session.session import Session

_DEFAULTS = CalibrationRequest()


@dataclass(frozen=True)
class _Measures:
    """Measurements of a run; all other fields and rungs of an earlier calibration are kept.

    scene: whether it needs shots of a scene though there are shots of a board; chart: whether a colour chart
    may be searched for; fields: of each camera.
    """

    sensors: bool = False
    light: bool = False
    chart: bool = False
    poses: bool = False
    scene: Literal["always", "without a board", "never"] = "always"
    fields: tuple[str, ...] = ()
    rungs: frozenset[str] = frozenset()


_ALL = _Measures(sensors=True, light=True, chart=True, poses=True, scene="without a board")
_PARTS: dict[Part, _Measures] = {
    "sensor": _Measures(sensors=True, scene="never", fields=("noise", "sensors"), rungs=NAMES),
    "response": _Measures(light=True, fields=("response",), rungs=LIGHT_RUNGS),
    "colour": _Measures(
        light=True,
        chart=True,
        fields=("camera_from_rec709", "chart"),
        rungs=frozenset({COLOUR, unfiltered.NAME, *CHART_RUNGS}),
    ),
    "luminance": _Measures(scene="always"),
    "poses": _Measures(sensors=True, poses=True, scene="without a board"),
}
_STATED = ("noise", "camera_from_rec709")
"""Fields that the files of a camera may state, so that no calibration has to measure them."""
_STATED_RUNGS = frozenset({"sensor_noise", COLOUR})


@one_thread_a_product()
@checked
def calibrate(
    session: str | PathLike[str],
    request: CalibrationRequest = _DEFAULTS,
    *,
    on_progress: Progress = unreported,
    **options: Any,
) -> CalibrationRecord:
    """Calibrate a session and write its `calibration/` folder, which is replaced as a whole or not at all.

    Args:
        session: Session, or its folder.
        request: Options.
        on_progress: Callback for the current step, the steps done, and all of them.
        options: Options by name, in place of those of `request`.

    Returns:
        The record that was written; views without a pose are listed in it.

    Raises:
        CalibrationError: No view can be placed and nothing else was measured, or an earlier calibration has
            poses, which then stays.
        PartialError: The board, the poses or the readings had to be left out of the record.
        InputError: The session is damaged, or an option cannot be used.
        StorageError: The disk refuses.
    """
    only, without = request.only, request.without or ()
    readings = () if isinstance(request.luminance, str) else request.luminance
    measures = _ALL if only is None else _PARTS[only]
    opened = Session.open(session)
    store.require_writable(_folder(opened))
    if request.chart and not measures.chart:
        raise InputError(f"a chart measures colour, not the {only}: leave --chart or --only {only} out.")
    require_places(opened, readings or ())
    if not measures.poses and (request.survey is not None or request.onto is not None):
        raise InputError(f"--survey and --onto place poses, not the {only}: leave them or --only {only} out.")
    if not measures.poses and without:
        raise InputError(
            f"--without leaves out what scene points show, not the {only}: leave it or --only {only} out."
        )
    if unknown := set(without) - set(get_args(LightPart)):
        parts = ", ".join(get_args(LightPart))
        raise InputError(f"there is no part {sorted(unknown)[0]!r} to leave out: choose from {parts}.")
    if value_of(request.survey) is not None and value_of(request.onto) is not None:
        raise InputError("A session has one system of coordinates: give --survey or --onto, not both.")
    if request.keep_doubtful and not measures.poses:
        raise InputError(f"--keep-doubtful is about poses, not the {only}: leave it or --only {only} out.")
    target = _target(opened, request) if measures.poses else None
    control = _control(opened, request) if target is None else None
    earlier = None if only is None else _earlier(opened)
    evidence = _evidence(opened, measures, earlier, on_progress)
    evidence = replace(evidence, readings=readings, control=control, target=target, without=without)
    if request.chart:
        charts = measure_charts(
            opened, evidence.views, evidence.sensors, evidence.light, earlier, on_progress
        )
        evidence = replace(evidence, charts=charts, sensors=charts.applied(evidence.sensors))
    if not measures.poses:
        record = _with_part(evidence, measures, earlier)
        if only == "colour" and earlier is not None:
            record = rebalanced(record)
        record = with_scales(record, evidence)
        missing = _missing_luminance(record, readings)
        if missing and only == "luminance":
            raise CalibrationError(f"{session}: {missing}.")
        store.write_json(_folder(opened) / "calibration.json", record.model_dump(mode="json"))
        if missing:
            raise PartialError(f"{session}: {only} is calibrated, and the light has no scale: {missing}.")
        return record
    evidence, refused = _with_board(evidence, request.board, on_progress)
    if evidence.views:
        record = with_poses(evidence, refused, request.keep_doubtful, on_progress)
    elif evidence.board is None and not evidence.has_sensor_frames:
        raise CalibrationError(refused)
    else:
        record = with_scales(assemble(evidence), evidence)
        write_calibration(opened, record, (), None, on_progress)
    if refused:
        raise PartialError(f"{session}: the board was left out, and the rest is calibrated: {refused}")
    if missing := _missing_luminance(record, readings):
        raise PartialError(f"{session}: everything is calibrated except the scale of light: {missing}.")
    if missing := _missing_coordinates(record, control, target):
        raise PartialError(f"{session}: everything is calibrated, but in arbitrary coordinates: {missing}.")
    return record


def _control(session: Session, request: CalibrationRequest) -> Control | None:
    """The surveyed points that are given, else those of the earlier calibration."""
    if forgets(request.survey):
        return None
    if request.survey is None and request.marks is None and request.markers is None:
        known = (_folder(session) / "calibration.json").exists()
        earlier = read_calibration(session.folder).coordinates if known else None
        return None if earlier is None else control_of(earlier)
    return read_control(session, request.survey, request.marks, request.markers)


def _target(session: Session, request: CalibrationRequest) -> Target | None:
    """The session whose coordinates are wanted, else that of the earlier calibration."""
    onto = value_of(request.onto)
    if request.onto is None and request.survey is None and (_folder(session) / "calibration.json").exists():
        earlier = read_calibration(session.folder).coordinates
        onto = None if earlier is None else earlier.onto
    if onto is None:
        return None
    if Path(onto).resolve() == session.folder.resolve():
        raise InputError(f"{session.folder} cannot be placed onto itself: name another session after --onto.")
    return read_target(Path(onto))


def _missing_coordinates(record: CalibrationRecord, control: Control | None, target: Target | None) -> str:
    """Return why the scene is not where it was to be placed; empty if it is, or if nothing was asked for."""
    asked = placing.NAME if control is not None else onto_session.NAME if target is not None else ""
    if not asked or not record.views or any(rung.name == asked and rung.taken for rung in record.rungs):
        return ""
    return next(rung.reason for rung in record.rungs if rung.name == asked)


def _missing_luminance(record: CalibrationRecord, readings: Sequence[LuminanceReading] | None) -> str:
    """Return why readings that were given gave no scale; empty if they did, or if none were given."""
    if not readings or record.luminance is not None:
        return ""
    return next(rung.reason for rung in record.rungs if rung.name == RUNG)


def _folder(session: Session) -> Path:
    return session.folder / "calibration"


def _earlier(session: Session) -> CalibrationRecord | None:
    """The calibration that a part is redone of; InputError when it belongs to other shots."""
    if not (_folder(session) / "calibration.json").exists():
        return None
    record = read_calibration(session.folder)
    if is_stale(session.folder, record):
        raise InputError(
            f"{_folder(session)} is older than the shots of the session: run `rig calibrate` without --only."
        )
    return record


def _evidence(
    session: Session, measures: _Measures, earlier: CalibrationRecord | None, progress: Progress
) -> Evidence:
    """Return what is known before any view is placed: measured, or taken from an earlier calibration."""
    # Darks and flats alone measure the sensor, a board alone lenses and rig.
    needless = measures.scene == "never" or (
        measures.scene == "without a board" and bool(session.shots("board"))
    )
    views = scene_views(session) if session.shots("scene") or not needless else []
    if measures.sensors or earlier is None:
        measured = measure_sensors(session, views, progress)
    else:
        measured = {camera.name: MeasuredSensor(at=camera.sensors) for camera in earlier.cameras}
    sensors = _sensors(session, views, measured)
    views = [replace(view, sensors=sensors[view.camera.name].measured.at) for view in views]
    if measures.light or earlier is None:
        light = radiometry.measure_light(session, views, progress)
    else:
        light = light_of(earlier, views)
    sensors = unfiltered.measured(session, views, sensors, light)
    charts = charts_of(earlier) if measures.poses and earlier is not None else Charts()
    return Evidence(session, views, charts.applied(sensors), light, charts)


def _sensors(
    session: Session, views: Sequence[View], measured: Mapping[str, MeasuredSensor]
) -> dict[str, CameraSensor]:
    """Every camera that has shots, by its first shot of the scene, or of whatever else."""
    first: dict[str, ShotRecord] = {}
    for shot in [*(view.shots[0] for view in views), *session.shots()]:
        first.setdefault(shot.camera, shot)
    sensors = {}
    for name, shot in first.items():
        sensor = metadata.describe(session, session.camera(name), shot)
        iso = None if shot.exposure is None else shot.exposure.iso
        sensors[name] = metadata.with_measured(sensor, measured.get(name, MeasuredSensor()), iso)
    return sensors


def _with_board(evidence: Evidence, board: Board | None, progress: Progress) -> tuple[Evidence, str]:
    """Add the calibration from the session's shots of a board; also the reason if that failed, else "".

    board: the board in the shots; None: that of the earlier calibration.
    """
    session = evidence.session
    if board is None and (_folder(session) / "calibration.json").exists():
        earlier = read_calibration(session.folder).board
        board = None if earlier is None else earlier.board
    try:
        return replace(evidence, board=measure_board(session, board, progress)), ""
    except CalibrationError as error:
        return evidence, str(error)


def _with_part(
    evidence: Evidence, measures: _Measures, earlier: CalibrationRecord | None
) -> CalibrationRecord:
    """An earlier calibration with one part of it measured again; without one, that part and what it needs."""
    fresh = assemble(replace(evidence, views=()))
    if earlier is None:
        return fresh
    # Poses that were given came without a look at what the files say of the cameras themselves.
    stated = not any(rung.name == COLOUR for rung in earlier.rungs)
    names = measures.rungs | (_STATED_RUNGS if stated else frozenset())
    cameras = []
    for camera in earlier.cameras:
        sensor = evidence.sensors.get(camera.name)
        flat = measures.sensors and sensor is not None and sensor.measured.falloff is not None
        fields = (*measures.fields, *(_STATED if stated else ()), *(("vignetting",) if flat else ()))
        new = fresh.camera(camera.name)
        cameras.append(camera.model_copy(update={field: getattr(new, field) for field in fields}))
    others = [rung for rung in earlier.rungs if rung.name not in names]
    update: dict[str, object] = {
        "created": fresh.created,
        "versions": fresh.versions,
        "cameras": tuple(cameras),
        "rungs": (*(rung for rung in fresh.rungs if rung.name in names), *others),
    }
    if "response" in measures.fields:
        developed = {view.id: view.exposure for view in earlier.views}
        update["exposure_scale"] = {
            shot.file: fresh.exposure_scale[shot.file] * developed.get(view.id, 1.0)
            for view in evidence.views
            for shot in view.shots
        }
    return earlier.model_copy(update=update)

"""Evidence of a session before its views are placed: measured, or of an earlier calibration."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from calib.boards.measure import MeasuredBoard, measure_board
from calib.colour import unfiltered
from calib.colour.colour_record import charts_of
from calib.colour.measure import Charts, measure_charts
from calib.data.views import View, scene_views
from calib.light import radiometry
from calib.light.radiometry import Radiometry, light_of
from calib.luminance.area import require_places
from calib.measures import MEASURES
from calib.request import CalibrationRequest, LightPart
from calib.sensor import metadata
from calib.sensor.measure import MeasuredSensor, measure_sensors
from calib.sensor.metadata import CameraSensor
from calib.survey.control_points import Control, control_of, read_control
from calib.survey.onto import Target, read_target
from imaging.errors import CalibrationError, InputError
from imaging.progress import Progress
from imaging.request import forgets, value_of
from imaging.session.calibration import CalibrationRecord, is_stale, read_calibration
from imaging.session.luminance import LuminanceReading
from imaging.session.records import Board, ShotRecord
from imaging.session.session import Session


@dataclass(frozen=True, eq=False)
class Evidence:
    """Evidence of a session before its views are placed; sensors: of every camera that has shots."""

    session: Session
    views: Sequence[View]
    sensors: Mapping[str, CameraSensor]
    light: Radiometry
    charts: Charts
    earlier: CalibrationRecord | None = None
    """The calibration that this one replaces."""
    readings: Sequence[LuminanceReading] | None = None
    """Readings of luminance; None: those of the earlier calibration."""
    board: MeasuredBoard | None = None
    control: Control | None = None
    """Surveyed points that the scene is placed by."""
    target: Target | None = None
    """A session in whose coordinates it is placed."""
    without: Collection[LightPart] = ()
    """Parts of the light that are not estimated from scene points."""

    @property
    def has_sensor_frames(self) -> bool:
        """True if there are darks or flats."""
        return bool(self.session.shots("dark") or self.session.shots("flat"))

    @property
    def measured(self) -> str:
        """Results that need no pose, as the beginning of a sentence; empty without any."""
        parts = {
            "exposures and response": self.light.measured,
            "the board's lenses": self.board is not None,
            "sensors": self.has_sensor_frames,
            "colours": bool(self.charts.evidence),
        }
        measured = ", ".join(part for part, there in parts.items() if there)
        if measured:
            return f"{measured} are measured"
        named = any(sensor.camera_from_rec709 is not None for sensor in self.sensors.values())
        return "colours are as the files say" if named else ""


def gather(session: Session, request: CalibrationRequest, progress: Progress) -> Evidence:
    """Measure what needs no poses, and take the rest from an earlier calibration.

    Args:
        session: Session to look at.
        request: Options; its part decides what is measured.
        progress: Callback for the current step, the steps done, and all of them.

    Returns:
        Evidence without a board, which `with_board` adds.

    Raises:
        CalibrationError: There are no shots of a scene, and what is asked for needs them.
        InputError: A reading, an earlier calibration, a survey or a target cannot be used, or a file is
            damaged.
    """
    measures = MEASURES[request.only]
    readings = () if isinstance(request.luminance, str) else request.luminance
    require_places(session, readings or ())
    earlier = _earlier(session, request)
    target = _target(session, request, earlier) if measures.poses else None
    control = _control(session, request, earlier) if target is None else None
    base = None if request.only is None else earlier
    # Darks and flats alone measure the sensor, a board alone lenses and rig.
    needless = measures.scene == "never" or (
        measures.scene == "without a board" and bool(session.shots("board"))
    )
    views = scene_views(session) if session.shots("scene") or not needless else []
    if measures.sensors or base is None:
        measured = measure_sensors(session, views, progress)
    else:
        measured = {camera.name: MeasuredSensor(at=camera.sensors) for camera in base.cameras}
    sensors = _sensors(session, views, measured)
    views = [replace(view, sensors=sensors[view.camera.name].measured.at) for view in views]
    if measures.light or base is None:
        light = radiometry.measure_light(session, views, progress)
    else:
        light = light_of(base, views)
    sensors = unfiltered.measured(session, views, sensors, light)
    charts = charts_of(base) if measures.poses and base is not None else Charts()
    sensors = charts.applied(sensors)
    if request.chart:
        charts = measure_charts(session, views, sensors, light, base, progress)
        sensors = charts.applied(sensors)
    return Evidence(
        session, views, sensors, light, charts, earlier, readings,
        control=control, target=target, without=request.without or (),
    )  # fmt: skip


def with_board(evidence: Evidence, board: Board | None, progress: Progress) -> tuple[Evidence, str]:
    """Add the calibration from the session's shots of a board; also the reason if that failed, else "".

    board: the board in the shots; None: that of the earlier calibration.
    """
    if board is None and evidence.earlier is not None and evidence.earlier.board is not None:
        board = evidence.earlier.board.board
    try:
        return replace(evidence, board=measure_board(evidence.session, board, progress)), ""
    except CalibrationError as error:
        return evidence, str(error)


def _earlier(session: Session, request: CalibrationRequest) -> CalibrationRecord | None:
    """The calibration of an earlier run; InputError if a part is to be redone of one of other shots."""
    folder = session.folder / "calibration"
    if not (folder / "calibration.json").exists():
        return None
    record = read_calibration(session.folder)
    if request.only is not None and is_stale(session.folder, record):
        raise InputError(
            f"{folder} is older than the shots of the session: run `rig calibrate` without --only."
        )
    return record


def _control(
    session: Session, request: CalibrationRequest, earlier: CalibrationRecord | None
) -> Control | None:
    """The surveyed points that are given, else those of the earlier calibration."""
    if forgets(request.survey):
        return None
    if request.survey is None:
        known = None if earlier is None else earlier.coordinates
        return None if known is None else control_of(known)
    return read_control(session, request.survey, request.marks, request.markers)


def _target(
    session: Session, request: CalibrationRequest, earlier: CalibrationRecord | None
) -> Target | None:
    """The session whose coordinates are wanted, else that of the earlier calibration."""
    onto = value_of(request.onto)
    if request.onto is None and request.survey is None and earlier is not None:
        onto = None if earlier.coordinates is None else earlier.coordinates.onto
    if onto is None:
        return None
    if Path(onto).resolve() == session.folder.resolve():
        raise InputError(f"{session.folder} cannot be placed onto itself: name another session after --onto.")
    try:
        return read_target(Path(onto))
    except InputError as error:
        if request.onto is not None:
            raise
        reason = str(error).removesuffix(".")
        raise InputError(f"{reason}, or drop this target of an earlier run with --onto none.") from error


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

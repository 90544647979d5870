"""`rig calibrate`: cameras, lenses and poses of a session."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from imaging.errors import PartialError
from rig.options.anchors import NO_ANCHORS, SURVEY_HELP, Anchors
from rig.options.board import EXAMPLE, BoardText, board_text
from rig.options.common import JsonOption, SessionArgument
from rig.options.luminance import HELP, ReadingText, reading_text, readings_of
from rig.terminal.progress import StatusLine
from rig.terminal.result import CommandResult, removed_on_failure, running
from rig.terminal.text import command_line, counted, duration, number

if TYPE_CHECKING:
    from calib.light import parts
    from imaging.session.calibration import CalibrationRecord
    from imaging.session.luminance import LuminanceReading
    from imaging.session.records import Board
    from imaging.session.view_id import ViewId

Part = Literal["sensor", "response", "colour", "poses", "luminance"]


class LightPart(StrEnum):
    """Parts of light that scene points tell, as `calib.light.parts` has them."""

    EXPOSURE = "exposure"
    WHITE_BALANCE = "white_balance"
    FALLOFF = "falloff"
    GAIN = "gain"


LIGHT: dict[str, tuple[LightPart, str]] = {
    "exposure_each_photograph": (LightPart.EXPOSURE, "exposure of each photograph"),
    "white_balance_each_photograph": (LightPart.WHITE_BALANCE, "white balance of each photograph"),
    "vignetting": (LightPart.FALLOFF, "falloff"),
    "vignetting_each_camera": (LightPart.FALLOFF, "falloff of each camera"),
    "camera_gain": (LightPart.GAIN, "sensitivity of each camera"),
    "white_balance": (LightPart.WHITE_BALANCE, "white balance between cameras"),
}
"""Which part each rung of light is of, and its name in words."""


def calibrate(
    session: SessionArgument,
    only: Annotated[
        Part | None, typer.Option(help="Redo only this part and keep the rest; works without poses too.")
    ] = None,
    board: Annotated[
        BoardText | None,
        typer.Option(
            parser=board_text,
            metavar="COLUMNSxROWS,...",
            help=f"ChArUco board layout, if the session does not record it: {EXAMPLE}.",
        ),
    ] = None,
    chart: Annotated[
        bool, typer.Option("--chart", help="Measure colours by a ColorChecker that some views show.")
    ] = False,
    luminance: Annotated[
        list[ReadingText] | None, typer.Option(parser=reading_text, metavar="READING", help=HELP)
    ] = None,
    survey: Annotated[Path | None, typer.Option(metavar="FILE", help=SURVEY_HELP, exists=False)] = None,
    marks: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Where images show surveyed points: a table with name,image,u,v in pixels."
        ),
    ] = None,
    markers: Annotated[
        str | None,
        typer.Option(
            metavar="DICTIONARY",
            help="Markers that stand on surveyed points, called by their numbers: DICT_APRILTAG_36H11.",
        ),
    ] = None,
    onto: Annotated[
        Path | None,
        typer.Option(
            metavar="SESSION",
            help="Take the coordinates of a calibrated session that shows the same scene; none forgets it.",
        ),
    ] = None,
    without: Annotated[
        list[LightPart] | None,
        typer.Option(
            metavar="PART",
            help="Leave out a part of what scene points tell of light: "
            f"{', '.join(LightPart)}. May be repeated.",
        ),
    ] = None,
    keep_doubtful: Annotated[
        bool,
        typer.Option(
            "--keep-doubtful",
            help="Keep views that others contradict about where they stand, with a warning that names them.",
        ),
    ] = False,
    as_json: JsonOption = False,
) -> CommandResult:
    """Calibrate cameras, lenses and poses.

    Poses, lenses, exposure ratios, response and vignetting come from the pictures themselves; the sensor
    from darks and flats, lenses, rig and scale from a board, where the session has them.
    Lengths are relative until a board, measured places of cameras, --survey or GPS positions in the files
    tell metres. Light is relative until --luminance says what it is in cd/m2; readings stay for later runs.
    Writes SESSION/calibration with a COLMAP model and report.html.

    Example: rig calibrate S
    """
    with running("calibrate") as status:
        described = board.board() if board else None
        anchors = Anchors(survey, marks, markers, onto)
        readings = readings_of(luminance)
        left_out: list[parts.LightPart] = [part.value for part in without or ()]
        return run_calibrate(
            session, status, only, described, chart, readings, anchors, left_out, keep_doubtful
        )


SECONDS = 6.0, 18.0
"""Of a processor, that a photograph takes in all, in sets that are soon done and in others: a castle,
6 megapixels, 6.6 (bench/results/calibration_size.md); a walk, 12 megapixels, 10.5 (calibration_full_size.md);
a telephone's video, 2 megapixels, 17.4."""
FULL = 2e6
"""Pixels from which on a photograph takes that long: features are looked for in no more."""
ON_ALL_CORES = 0.53
"""Share of that time which all cores do; the rest is done by one (calibration_full_size.md)."""
WORTH_SAYING = 30.0


def expected(sizes: Sequence[int], cores: int) -> str | None:
    """How long a calibration of views with so many pixels each takes, in words; None: not worth a word."""
    clock = (1 - ON_ALL_CORES + ON_ALL_CORES / cores) * sum(min(1.0, size / FULL) for size in sizes)
    low, high = (clock * seconds for seconds in SECONDS)
    if high < WORTH_SAYING:
        return None
    return (
        f"{counted(len(sizes), 'view')} on {counted(cores, 'core')}: this takes {duration(low)} to "
        f"{duration(high)} in all, if nothing else runs here."
    )


def _say_how_long(session: Path, status: StatusLine) -> None:
    from imaging.compute.cores import available_cores
    from imaging.session.session import Session, brackets

    views = brackets(Session.open(session).shots("scene")).values()
    words = expected([shots[0].width * shots[0].height for shots in views], available_cores())
    if words is not None:
        status.say(words)


def run_calibrate(
    session: Path,
    status: StatusLine,
    only: Part | None = None,
    board: "Board | None" = None,
    chart: bool = False,
    luminance: "Sequence[LuminanceReading] | None" = None,
    anchors: Anchors = NO_ANCHORS,
    without: "Sequence[parts.LightPart]" = (),
    keep_doubtful: bool = False,
) -> CommandResult:
    """Calibrate, write the report and say what came of it."""
    folder = session / "calibration"
    with removed_on_failure(folder, unless=lambda path: (path / "calibration.json").is_file()):
        from calib.calibrate import calibrate as calibrate_session
        from rig.report.pages.calibration import calibration_report

        if only in (None, "poses"):
            _say_how_long(session, status)
        try:
            record = calibrate_session(
                session, only=only, board=board, chart=chart, luminance=luminance, survey=anchors.survey,
                marks=anchors.marks, markers=anchors.markers, onto=anchors.onto, without=without,
                keep_doubtful=keep_doubtful, on_progress=status,
            )  # fmt: skip
        except PartialError:
            # What was measured has its page too; the error says what is missing.
            calibration_report(session, on_progress=status)
            raise
    calibration_report(session, on_progress=status)
    poseless = not record.views and not record.unregistered
    return (
        _cameras_result(session, record)
        if poseless or (only and not record.views)
        else poses_result(session, record)
    )


def earlier_calibration(session: Path) -> CommandResult:
    """What the calibration that a session has came to."""
    from imaging.session.calibration import read_calibration

    return replace(poses_result(session, read_calibration(session)), already_there=True)


def _cameras_result(session: Path, record: "CalibrationRecord") -> CommandResult:
    """What came of a calibration of cameras without poses."""
    report = session / "calibration" / "report.html"
    evidence = {camera.name: camera.response.evidence for camera in record.cameras}
    responses = {camera.name: camera.response.kind for camera in record.cameras}
    lines = [f"{session}: {name}: {responses[name]}, {why}" for name, why in evidence.items()]
    for camera in record.cameras:
        for sensor in camera.sensors:
            words = [
                f"{what} {number(value.value)} ± {number(value.sigma)} {unit}".rstrip()
                for what, value, unit in (
                    ("gain", sensor.gain, "DN/e⁻"),
                    ("read noise", sensor.read_noise, "e⁻"),
                    ("ceiling", sensor.ceiling, "DN"),
                )
                if value is not None
            ]
            at = "" if sensor.iso is None else f" at ISO {sensor.iso:g}"
            figures = ", ".join(words) or "gain, read noise and ceiling are not determined"
            lines.append(f"{session}: {camera.name}{at}: {figures}")
    sensors = {
        camera.name: [
            sensor.model_dump(mode="json", exclude={"defects", "transfer"}) for sensor in camera.sensors
        ]
        for camera in record.cameras
    }
    data = {
        "session": str(session),
        "responses": responses,
        "luminance": _luminance_figures(record),
        "sensors": sensors,
        "charts": _chart_figures(record),
        "report": str(report),
    }
    lines += [*_chart_lines(session, record), *_luminance_lines(session, record)]
    return CommandResult(data, [*lines, f"Report: {report}"])


def _chart_lines(session: Path, record: "CalibrationRecord") -> list[str]:
    """A line for each camera that saw a chart: how well its colours fit."""
    return [
        f"{session}: {name}: colours by the chart at frame {chart['frame']}, delta E 2000 of held-out "
        f"patches {number(chart['delta_e_mean'])} in the mean, {number(chart['delta_e_max'])} at most"
        for name, chart in _chart_figures(record).items()
    ]


def _luminance_lines(session: Path, record: "CalibrationRecord") -> Iterator[str]:
    """The scale of light and its readings; why one of an earlier run is lost."""
    scale = record.luminance
    if scale is None:
        for rung in record.rungs:
            if rung.name == "luminance":
                yield f"{session}: the light has no scale in cd/m2 any more: {rung.reason}"
        return
    yield f"{session}: light of 1 is {scale}, for {', '.join(scale.cameras)}"
    if len(scale.readings) > 1:
        for one in scale.readings:
            percent = f"{100 * one.residual:+.2g}".replace("-", "−")
            yield f"{session}: {one.reading}: {number(one.luminance)} cd/m², {percent} % off that scale"


def _light_lines(session: Path, record: "CalibrationRecord") -> Iterator[str]:
    """A line for each part of light that was taken, with its size and how to do without it."""
    for rung in record.rungs:
        if rung.taken and rung.name in LIGHT:
            part, name = LIGHT[rung.name]
            yield f"{session}: {name}: {rung.reason} (--without {part} leaves it out)"


def _coordinate_lines(session: Path, record: "CalibrationRecord") -> Iterator[str]:
    """What coordinates the scene is in, how sure that is, and each surveyed point."""
    from imaging.session.coordinates import length_text

    where = record.coordinates
    for rung in record.rungs:
        if rung.name in ("survey", "gps", "onto"):
            yield f"{session}: {rung.name}: {rung.reason}"
    if where is None:
        return
    metric = record.unit == "m"
    place = length_text(where.position_error) if metric else number(where.position_error, 2)
    scale = "" if where.scale_error is None else f"scale to {number(100 * where.scale_error, 2)} %, "
    yield (
        f"{session}: coordinates are {where.described}{where.less_offset}, "
        f"{'in metres' if metric else 'without a unit'}: {scale}"
        f"turn to {number(where.rotation_error, 2)}°, place to {place} (standard errors)"
    )
    for point in where.points:
        yield f"{session}: {point}"


def _luminance_figures(record: "CalibrationRecord") -> dict[str, Any] | None:
    """The scale of light; None: it is relative."""
    return None if record.luminance is None else record.luminance.model_dump(mode="json")


def _chart_figures(record: "CalibrationRecord") -> dict[str, dict[str, Any]]:
    """The figures of each camera's chart, by its name."""
    fields = {"frame", "delta_e_mean", "delta_e_p95", "delta_e_max", "delta_e_files"}
    return {
        camera.name: camera.chart.model_dump(mode="json", include=fields)
        for camera in record.cameras
        if camera.chart is not None
    }


def _left_out(record: "CalibrationRecord") -> Iterator[str]:
    """The images without a pose, by cause, with what to do about it."""
    alone = [str(view) for view in record.unregistered if view not in record.contradicted]
    if alone:
        yield f"take more pictures that overlap with {', '.join(alone)}"
    contradicted = [str(view) for view in record.unregistered if view in record.contradicted]
    if contradicted:
        yield (
            f"{', '.join(contradicted)} would stand where other views contradict, as where parts of a "
            "scene look alike: take more pictures around them, put something unique beside them, or "
            "keep them with --keep-doubtful"
        )


def _why_unplaced(record: "CalibrationRecord", view: "ViewId") -> str:
    """Why an image got no pose from what it shows."""
    if view in record.contradicted:
        return "contradicts other images about where it stands"
    return "shows nothing that was recognised"


def poses_result(session: Path, record: "CalibrationRecord") -> CommandResult:
    """What came of a calibration with poses."""
    from imaging.session.calibration import MOTION

    report = session / "calibration" / "report.html"
    images = len(record.views) + len(record.unregistered)
    by_rig = [view.id for view in record.views if view.by_rig]
    lines = [
        f"{session}: {len(record.views)} of {counted(images, 'image')} with a pose, "
        f"{counted(record.points, 'scene point')}, reprojection error {number(record.reprojection_px)} px",
        *[f"{session}: {view} {_why_unplaced(record, view)}: its pose is the rig's" for view in by_rig],
        *[f"{session}: {rung.reason}" for rung in record.rungs if rung.name == MOTION],
        *[f"{session}: {doubt}" for doubt in record.doubts],
        *_light_lines(session, record),
        *_coordinate_lines(session, record),
        *_chart_lines(session, record),
        *_luminance_lines(session, record),
        f"Report: {report}",
        f"Next: {command_line('rig', 'reconstruct', session)}",
    ]
    data = {
        "session": str(session),
        "registered": len(record.views),
        "images": images,
        "unregistered": [str(view) for view in record.unregistered],
        "contradicted": [str(view) for view in record.contradicted],
        "by_rig": [str(view) for view in by_rig],
        "doubts": list(record.doubts),
        "points": record.points,
        "reprojection_px": record.reprojection_px,
        "luminance": _luminance_figures(record),
        "charts": _chart_figures(record),
        "unit": record.unit,
        "coordinates": None if record.coordinates is None else record.coordinates.model_dump(mode="json"),
        "report": str(report),
    }
    missing = None
    if record.unregistered:
        missing = (
            f"{session}: {counted(len(record.unregistered), 'image')} of {images} got no pose: "
            + "; ".join(_left_out(record))
        )
    return CommandResult(data, lines, missing, usable=bool(record.views))

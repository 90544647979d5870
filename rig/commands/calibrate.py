"""`rig calibrate`: find out what the cameras did."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from imaging.errors import PartialError
from rig.commands.board import EXAMPLE, BoardText, board_text
from rig.commands.options import JsonOption, SessionArgument
from rig.progress import Meter
from rig.running import Outcome, leaving_nothing, running
from rig.words import counted, number

if TYPE_CHECKING:
    from imaging.calibration import CalibrationRecord
    from imaging.records import Board

Part = Literal["sensor", "response", "colour", "poses"]


def calibrate(
    session: SessionArgument,
    only: Annotated[
        Part | None, typer.Option(help="Redo this part and keep the rest; all but poses need no poses.")
    ] = None,
    board: Annotated[
        BoardText | None,
        typer.Option(
            parser=board_text,
            metavar="COLUMNSxROWS,...",
            help=f"The ChArUco board in the session's shots of one, where these do not say: {EXAMPLE}.",
        ),
    ] = None,
    as_json: JsonOption = False,
) -> Outcome:
    """Find out what the cameras did.

    Poses, lenses, exposure ratios, response and vignetting come from the pictures themselves.
    Writes SESSION/calibration with a COLMAP model and report.html.

    Example: rig calibrate S
    """
    with running("calibrate") as meter:
        return run_calibrate(session, meter, only, board.board() if board else None)


def run_calibrate(
    session: Path, meter: Meter, only: Part | None = None, board: "Board | None" = None
) -> Outcome:
    """Calibrate, write the report and say what came of it."""
    folder = session / "calibration"
    with leaving_nothing(folder, unless=lambda path: (path / "calibration.json").is_file()):
        from calib.calibrate import calibrate as calibrate_session
        from rig.report.calibration_page import calibration_report

        try:
            record = calibrate_session(session, only=only, board=board, progress=meter)
        except PartialError:
            # What was found has its page too; the error says what is missing.
            calibration_report(session, meter)
            raise
    calibration_report(session, meter)
    poseless = not record.views and not record.unregistered
    return told_cameras(session, record) if poseless or (only and not record.views) else told(session, record)


def calibration_outcome(session: Path) -> Outcome:
    """What the calibration that a session has came to."""
    from imaging.calibration import read_calibration

    return told(session, read_calibration(session))


def told_cameras(session: Path, record: "CalibrationRecord") -> Outcome:
    """A calibration of cameras without poses as an outcome."""
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
            found = ", ".join(words) or "gain, read noise and ceiling are not determined"
            lines.append(f"{session}: {camera.name}{at}: {found}")
    sensors = {
        camera.name: [
            sensor.model_dump(mode="json", exclude={"defects", "transfer"}) for sensor in camera.sensors
        ]
        for camera in record.cameras
    }
    data = {"session": str(session), "responses": responses, "sensors": sensors, "report": str(report)}
    return Outcome(data, [*lines, f"Report: {report}"])


def told(session: Path, record: "CalibrationRecord") -> Outcome:
    """A calibration as an outcome."""
    report = session / "calibration" / "report.html"
    images = len(record.views) + len(record.unregistered)
    lines = [
        f"{session}: {len(record.views)} of {counted(images, 'image')} with a pose, "
        f"{counted(record.points, 'scene point')}, reprojection error {number(record.reprojection_px)} px",
        f"Report: {report}",
        f"Next: rig reconstruct {session}",
    ]
    data = {
        "session": str(session),
        "registered": len(record.views),
        "images": images,
        "unregistered": list(record.unregistered),
        "points": record.points,
        "reprojection_px": record.reprojection_px,
        "report": str(report),
    }
    missing = None
    if record.unregistered:
        missing = (
            f"{session}: {counted(len(record.unregistered), 'image')} of {images} got no pose "
            f"({', '.join(record.unregistered)}): take more pictures that overlap with them."
        )
    return Outcome(data, lines, missing, usable=bool(record.views))

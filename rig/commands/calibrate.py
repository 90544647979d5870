"""`rig calibrate`: cameras, lenses and poses of a session."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, get_args

from calib import calibrate as calibrating
from calib.request import CalibrationRequest, LightPart
from imaging.compute.cores import available_cores
from imaging.compute.free_share import free_share, if_so
from imaging.errors import PartialError
from imaging.session import calibration as calibrations
from imaging.session import session as sessions
from rig.options.board_text import EXAMPLE, BoardText, board_text
from rig.options.common import JsonOption, SessionArgument
from rig.options.luminance_readings import HELP, ReadingText, reading_text, readings_of
from rig.options.request import Asked, Shown
from rig.report.pages import calibration as calibration_page
from rig.terminal import calibration_result as results
from rig.terminal.progress import StatusLine
from rig.terminal.result import CommandResult, removed_on_failure, running
from rig.terminal.text import counted, duration

NO_OPTIONS = CalibrationRequest()
OPTIONS = Asked(
    board=Shown(
        kind=BoardText | None,
        made=BoardText.board,
        more=f"Such as {EXAMPLE}.",
        how={"parser": board_text, "metavar": "COLUMNSxROWS,..."},
    ),
    luminance=Shown(
        kind=list[ReadingText] | None,
        made=readings_of,
        more=HELP,
        how={"parser": reading_text, "metavar": "READING"},
    ),
    survey=Shown(how={"metavar": "FILE"}),
    marks=Shown(how={"metavar": "FILE"}),
    markers=Shown(how={"metavar": "DICTIONARY"}),
    onto=Shown(how={"metavar": "SESSION"}),
    without=Shown(
        made=lambda parts: [str(part) for part in parts],
        more=f"PART is one of {', '.join(get_args(LightPart))}; may be repeated.",
        how={"metavar": "PART"},
    ),
)


def calibrate(
    session: SessionArgument,
    request: Annotated[CalibrationRequest, OPTIONS] = NO_OPTIONS,
    as_json: JsonOption = False,
) -> CommandResult:
    """Calibrate cameras, lenses and poses.

    Estimates poses, lenses, exposure ratios, response and vignetting from the pictures themselves; the sensor
    from darks and flats, and lenses, rig and scale from a board, if the session has them. Scale is arbitrary
    unless a board, measured camera positions, --survey or GPS positions in the files provide metres. Light is
    relative unless --luminance provides cd/m2; readings are kept for later runs. Writes SESSION/calibration
    with a COLMAP model and report.html.

    Example: rig calibrate S
    """
    with running("calibrate") as status:
        return run_calibrate(session, status, request)


EACH, FULL_SIZE = (0.7, 4.0), (5.3, 15.0)
"""CPU seconds per view, (fast sets, slow sets): fixed part, and part at full resolution. Measured, both parts
together: a simulated rig, 320 px, 1.1 (bench/results/calibration_size.md); a walk, 12 megapixels, 10.5
(calibration_full_size.md); brighton 7.4, sceaux 10.3, fox 13.7, banana 18.8 (real_judges.md). Objects of
metal and glass, 400 px, take 8.0, twice the estimate.
"""
FULL = 2e6
"""Pixels from which on a photograph takes that long: features are looked for in no more."""
ON_ALL_CORES = 0.53
"""Share of that time which all cores do; the rest is done by one (calibration_full_size.md)."""
WORTH_SAYING = 30.0


def expected(sizes: Sequence[int], cores: int) -> tuple[float, float]:
    """Seconds of the clock, at least and at most, that the calibration of views with these numbers of pixels
    takes on cores that do nothing else.
    """
    clock = 1 - ON_ALL_CORES + ON_ALL_CORES / cores
    full = sum(min(1.0, size / FULL) for size in sizes)
    low, high = (clock * (len(sizes) * each + full * of) for each, of in zip(EACH, FULL_SIZE, strict=True))
    return low, high


def in_words(sizes: Sequence[int], cores: int, free: float) -> str:
    """Duration of that, where other work leaves that share of the cores."""
    share, condition = if_so(free)
    low, high = (seconds / share for seconds in expected(sizes, cores))
    return (
        f"{counted(len(sizes), 'view')} on {counted(cores, 'core')}: this takes {duration(low)} to "
        f"{duration(high)} in all, {condition}."
    )


def _say_how_long(session: Path, status: StatusLine) -> None:

    views = sessions.brackets(sessions.Session.open(session).shots("scene")).values()
    sizes, cores = [shots[0].width * shots[0].height for shots in views], available_cores()
    if expected(sizes, cores)[1] >= WORTH_SAYING:
        status.say(in_words(sizes, cores, free_share(cores)))


def run_calibrate(
    session: Path, status: StatusLine, request: CalibrationRequest = NO_OPTIONS
) -> CommandResult:
    """Calibrate, write the report and say what came of it."""
    folder = session / "calibration"
    with removed_on_failure(folder, unless=lambda path: (path / "calibration.json").is_file()):
        if request.only in (None, "poses"):
            _say_how_long(session, status)
        try:
            record = calibrating.calibrate(session, request, on_progress=status)
        except PartialError:
            # What was measured has its page too; the error says what is missing.
            calibration_page.calibration_report(session, on_progress=status)
            raise
    calibration_page.calibration_report(session, on_progress=status)
    poseless = not record.views and not record.unregistered
    return (
        results.cameras_result(session, record)
        if poseless or (request.only and not record.views)
        else results.poses_result(session, record)
    )


def earlier_calibration(session: Path) -> CommandResult:
    """Summary of the calibration of a session."""
    return replace(results.poses_result(session, calibrations.read_calibration(session)), already_there=True)

"""SESSION/calibration/report.html: what was captured and calibrated."""

from collections.abc import Iterable
from importlib.metadata import version
from os import PathLike
from pathlib import Path

from imaging.arguments import checked
from imaging.progress import Progress, unreported
from imaging.session.calibration import CalibrationRecord, is_stale, read_calibration
from imaging.session.session import Session
from rig.report.charts.topic import Tile, plus_minus
from rig.report.page import Page, now, write_page
from rig.report.sections.calibrated import calibrated
from rig.report.sections.captured import captured
from rig.report.sections.provenance import provenance
from rig.terminal.text import number


def _tiles(record: CalibrationRecord, registered: str) -> Iterable[Tile]:
    if record.views or record.unregistered:
        yield Tile(registered, "", "images with a pose")
    if record.views:
        unit = "px" if record.reprojection_px is not None else ""
        yield Tile(number(record.reprojection_px), unit, "mean reprojection error")
        yield Tile(f"{record.points:,}", "", "scene points")
    else:
        sensors = sum(bool(camera.sensors) for camera in record.cameras)
        curves = sum(camera.response.residual is not None for camera in record.cameras)
        yield Tile(f"{sensors} of {len(record.cameras)}", "", "sensors measured")
        yield Tile(f"{curves} of {len(record.cameras)}", "", "responses measured")
    if record.luminance is not None:
        scale = record.luminance
        yield Tile(plus_minus(scale.value, scale.error), "cd/m²", "of light of 1")
    if record.board is not None:
        yield Tile(number(record.board.rms_px), "px", "rms of the board's corners")


@checked
def calibration_report(folder: str | PathLike[str], *, on_progress: Progress = unreported) -> Path:
    """Write SESSION/calibration/report.html.

    Args:
        folder: Session, or its folder.
        on_progress: Callback for the current step, the steps done, and all of them.

    Returns:
        The page.

    Raises:
        InputError: The session has no calibration.
        StorageError: The disk refuses.
    """
    folder = Path(folder)
    session, record = Session.open(folder), read_calibration(folder)
    section = calibrated(session, record, is_stale(session.folder, record))
    page = Page(
        kind="Calibration report",
        title=session.record.name,
        lead=section.summary + ".",
        version=version("hdr-rig"),
        made=now(),
        tiles=tuple(_tiles(record, section.registered)),
        sections={
            "captured": captured(session, record, on_progress),
            "calibrated": section,
            "provenance": provenance(session, record, None, version("hdr-rig")),
        },
    )
    path = folder / "calibration" / "report.html"
    write_page(path, page)
    return path
